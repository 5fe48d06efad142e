"""Where the camera's head pointed when an image was taken."""

from collections import deque
from dataclasses import replace

from followerd.geometry import wrap_angle
from followerd.messages import Image, PtzState

KEPT = 64  # states
AHEAD = 0.15  # s after the newest state for which a moving head is extrapolated
RESTING = 1.5  # s after it for which a resting head is taken to rest


class Gaze:
    """The newest states of the head, in order of their stamps."""

    def __init__(self) -> None:
        self._states: deque[PtzState] = deque(maxlen=KEPT)

    def note(self, state: PtzState) -> None:
        """The head reports; what is not newer than the last report is left out."""
        if not self._states or state.stamp > self._states[-1].stamp:
            self._states.append(state)

    def at(self, stamp: float) -> PtzState | None:
        """The head at `stamp`, between two reports or shortly after the last; None = unknown."""
        if not self._states or stamp < self._states[0].stamp:
            return None
        newest = self._states[-1]
        if stamp >= newest.stamp:
            if stamp - newest.stamp > (AHEAD if newest.moving else RESTING):
                return None
            if not newest.moving or len(self._states) == 1:
                return replace(newest, stamp=stamp)
            return _between(self._states[-2], newest, stamp)
        later = next(i for i, state in enumerate(self._states) if state.stamp > stamp)
        return _between(self._states[later - 1], self._states[later], stamp)

    def aimed(self, image: Image) -> Image | None:
        """The image with its camera as it was turned and zoomed; None when that is not known."""
        state = self.at(image.stamp)
        if state is None:
            return None
        return replace(image, camera=image.camera.turned(state.pan, state.tilt, state.zoom))


def _between(before: PtzState, after: PtzState, stamp: float) -> PtzState:
    """On the straight line through two states."""
    share = (stamp - before.stamp) / (after.stamp - before.stamp)
    return PtzState(
        stamp,
        wrap_angle(before.pan + share * wrap_angle(after.pan - before.pan)),
        before.tilt + share * (after.tilt - before.tilt),
        before.zoom * (after.zoom / before.zoom) ** share,
        before.moving or after.moving,
    )
