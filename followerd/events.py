"""What the pipeline hears of, in the order in which it happened."""

from dataclasses import dataclass

from followerd.control.transitions import Action
from followerd.messages import Chassis, Fault, Odometry, Scan, TrackState, Twist


@dataclass(frozen=True, slots=True)
class Tracked:
    """The tracker has finished an image or a scan."""

    stamp: float  # s, of the image or scan
    received: float  # s, of the image or scan
    frame_id: int | None  # None: it was a scan
    track: TrackState | None  # None: nobody is enrolled


@dataclass(frozen=True, slots=True)
class Operator:
    """Somebody asks for something; the first track after ENROL is the new person's."""

    action: Action
    session: str = ""


@dataclass(frozen=True, slots=True)
class Presence:
    """A sign that an operator's session is there, or (not `here`) that it is over."""

    session: str
    here: bool = True


@dataclass(frozen=True, slots=True)
class Hand:
    """What the hand of an operator who drives asks for; must be said again and again."""

    session: str
    wanted: Twist


@dataclass(frozen=True, slots=True)
class Late:
    """The loop was held up: nothing was heard or decided meanwhile."""

    seconds: float


@dataclass(frozen=True, slots=True)
class Coming:
    """The first bytes of a stream's next measurement are here."""

    stream: str


@dataclass(frozen=True, slots=True)
class Tick:
    """Time has passed."""


Event = (
    Scan | Odometry | Tracked | Operator | Presence | Hand | Late | Fault | Coming | Chassis | Tick
)
