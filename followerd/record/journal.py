"""What a recording must hold for a replay: what the daemon consumed, in the order of consumption.

Images stand on their own channel; here only their numbers.
"""

from dataclasses import dataclass

from followerd.events import Event
from followerd.geometry import Pose2
from followerd.messages import Box, Place


@dataclass(frozen=True, slots=True)
class Taken:
    """The pipeline took an event."""

    now: float  # s
    event: Event


@dataclass(frozen=True, slots=True)
class Looked:
    """The tracker took up a frame."""

    now: float  # s
    frame_id: int
    ego: Pose2 | None  # as it was given to the tracker
    place: Place | None  # likewise


@dataclass(frozen=True, slots=True)
class Enrolled:
    """A person was shown to the tracker."""

    now: float  # s
    frame_id: int | None  # None: a point of a scan, not of a picture
    region: Box | tuple[float, float]


@dataclass(frozen=True, slots=True)
class Dropped:
    """A newer frame came before the tracker could take up this one."""

    now: float  # s
    frame_id: int


Entry = Taken | Looked | Enrolled | Dropped
