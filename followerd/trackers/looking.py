"""What the image tracker is shown: pure, so that a replay shows it the same."""

from collections import deque
from collections.abc import Callable
from zlib import crc32

from followerd.errors import UsageError
from followerd.geometry import Pose2
from followerd.messages import Box, Image, Place, TrackState
from followerd.perception.noise import is_noise
from followerd.trackers.interfaces import Tracker

HISTORY = 45  # frames kept so that a click on a frame seen a moment ago can be honoured
EVERY = 8  # of a picture's rows that are compared
MOST_LEFT_OUT = 2  # frames between the one that was clicked and the next that was taken up

Seen = tuple[Image, Pose2 | None, Place | None]  # and where robot and person are then


class Looking:
    """A tracker, and the frames it was shown last."""

    def __init__(
        self,
        tracker: Tracker | None,
        ego_at: Callable[[float], Pose2 | None],
        place_at: Callable[[float], Place | None],
    ) -> None:
        """Without a `tracker` pictures are only kept, to be clicked on."""
        self._tracker = tracker
        self._ego_at = ego_at
        self._place_at = place_at
        self._history: deque[Seen] = deque(maxlen=HISTORY)
        self._checksum: int | None = None  # of the newest picture

    @property
    def tracks(self) -> bool:
        """Whether there is a tracker."""
        return self._tracker is not None

    @property
    def newest(self) -> Image | None:
        """The newest frame that was taken up."""
        return self._history[-1][0] if self._history else None

    def take(self, image: Image) -> Seen:
        """Take up a frame, with what is known at this moment."""
        seen = image, self._ego_at(image.stamp), self._place_at(image.stamp)
        self._history.append(seen)
        return seen

    def step(self, seen: Seen) -> tuple[bool, TrackState | None]:
        """Let the tracker look: whether the picture is a new one, and the track; may take a while.

        A stuck camera repeats itself; a real picture is noisy, but not noise. What is repeated or
        shows nothing is not looked at, so the stream goes stale and everything follows from that
        (FAILSAFES F3).
        """
        before, self._checksum = self._checksum, crc32(seen[0].pixels[::EVERY].tobytes())
        if self._checksum == before or self._tracker is None or is_noise(seen[0].pixels):
            return False, None
        return True, self._tracker.step(*seen)

    def find(self, frame_id: int | None) -> Seen:
        """A frame taken up a moment ago; None: the newest. Raises UsageError when it is gone.

        In place of one that was left out because a newer one waited it is that newer one.
        """
        if not self._history:
            raise UsageError("no camera image yet; wait for the camera")
        if frame_id is None:
            return self._history[-1]
        if frame_id >= self._history[0][0].id:
            for seen in self._history:
                if 0 <= seen[0].id - frame_id <= MOST_LEFT_OUT:
                    return seen
        raise UsageError(f"frame {frame_id} is too old or unknown; click on the newest picture")

    def later(self, frame_id: int) -> list[Seen]:
        """The frames taken up after that one."""
        return [seen for seen in self._history if seen[0].id > frame_id]

    def enrol(self, seen: Seen, region: Box | tuple[float, float]) -> tuple[Image, TrackState]:
        """Show the tracker a person, then what happened since; the newest image and its track.

        Raises UsageError when the frame shows nothing to learn; may take a while.
        """
        if self._tracker is None:
            raise UsageError("nobody is followed in images here")
        image, ego, _ = seen
        state = self._tracker.enrol(image, region, ego)
        for after in self.later(image.id):
            state = self._tracker.step(*after) or state
            image = after[0]
        return image, state
