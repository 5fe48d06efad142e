"""The nouns: everything that flows between the layers. SI units, REP-103 axes, loop time.

`stamp` is when a measurement happened, `received` when it was complete in memory; both are
seconds of the event loop's clock. Frames: `odom`, `base`, `laser`, `camera` (see geometry).
"""

from dataclasses import dataclass, field
from enum import Enum
from functools import lru_cache
from math import hypot

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera, Pose2

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Box:
    """An image rectangle: top left corner and size, px, 0-based."""

    x: float
    y: float
    w: float
    h: float

    @property
    def centre(self) -> tuple[float, float]:
        """Centre (x, y), px."""
        return self.x + 0.5 * self.w, self.y + 0.5 * self.h

    @property
    def foot(self) -> tuple[float, float]:
        """Middle of the lower edge (x, y), px."""
        return self.x + 0.5 * self.w, self.y + self.h

    @classmethod
    def around(cls, x: float, y: float, w: float, h: float) -> "Box":
        """The box of size (w, h) centred on (x, y)."""
        return cls(x - 0.5 * w, y - 0.5 * h, w, h)


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """One frame of a camera."""

    id: int  # counts the device's frames from 0
    stamp: float  # s, middle of the exposure
    received: float  # s
    pixels: Pixels  # (H, W, 3) BGR or (H, W) grey or thermal
    camera: Camera
    depth: npt.NDArray[np.float32] | None = None  # (H, W) m along the axis, nan = unknown
    jpeg: bytes | None = None  # as the camera sent it, before its lens was undone; None = raw


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One sweep of a planar range finder, counter-clockwise."""

    stamp: float  # s, first beam measured
    received: float  # s, last byte of the telegram
    angle_min: float  # rad, bearing of ranges[0] in `laser`
    angle_increment: float  # rad per beam, > 0
    ranges: Array  # (N,) m; inf = no echo, nan = not measured (dazzled, error)
    range_max: float  # m
    beam_times: Array  # (N,) s after `stamp`
    base_from_laser: Pose2
    degraded: bool = False  # the device reports pollution or a warning
    reflection: Array | None = None  # (N,) 0..1 of the device's scale, where it tells

    @property
    def angles(self) -> Array:
        """Bearings (N,) in `laser`, rad."""
        return self.angle_min + self.angle_increment * np.arange(self.ranges.size)

    def points(self) -> Array:
        """End points (N, 2) in `base`, m; nan where there is no finite range."""
        r = np.where(np.isfinite(self.ranges), self.ranges, np.nan)
        ways = _directions(self.angle_min, self.angle_increment, self.ranges.size)
        return self.base_from_laser.apply(r[:, None] * ways)


@lru_cache(maxsize=8)
def _directions(first: float, step: float, count: int) -> Array:
    """Unit vectors (N, 2) of a fan of beams; a device keeps its fan."""
    angles = first + step * np.arange(count)
    return np.column_stack([np.cos(angles), np.sin(angles)])


@dataclass(frozen=True, slots=True, eq=False)
class Clusters:
    """The K groups of neighbouring returns of one scan, counter-clockwise; in `base`."""

    stamp: float  # s, of the scan
    first: npt.NDArray[np.intp]  # (K,) index of the first beam
    last: npt.NDArray[np.intp]  # (K,) index of the last beam
    count: npt.NDArray[np.intp]  # (K,) returns
    centre: Array  # (K, 2) m, mean of the returns
    bearing: Array  # (K,) rad, of the centre
    range: Array  # (K,) m, of the centre
    nearest: Array  # (K,) m, of the nearest return
    width: Array  # (K,) m, from the first to the last return
    leg_like: npt.NDArray[np.bool_]  # (K,) as narrow as a leg or two, not half hidden
    thin: npt.NDArray[np.bool_]  # (K,) too few returns for that, but far off a leg gives no more


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A straight wall in a scan: x cos(alpha) + y sin(alpha) = rho, rho >= 0."""

    alpha: float  # rad, direction of the normal
    rho: float  # m
    covariance: Array  # (2, 2) of (alpha, rho)
    ends: Array  # (2, 2) m, counter-clockwise
    first: int  # index of its first point in the scan
    last: int  # index of its last point

    @property
    def length(self) -> float:
        """Length, m."""
        return hypot(*(self.ends[1] - self.ends[0]))


@dataclass(frozen=True, slots=True)
class Twist:
    """Planar velocity of `base`."""

    v: float = 0.0  # m/s, forward
    omega: float = 0.0  # rad/s, left


@dataclass(frozen=True, slots=True)
class WheelSpeeds:
    """Wheel surface speeds of a differential drive."""

    left: float  # m/s
    right: float  # m/s

    @property
    def v(self) -> float:
        """Forward speed, m/s."""
        return 0.5 * (self.left + self.right)


@dataclass(frozen=True, slots=True)
class TurnBy:
    """A remaining turn that replaces a pending one, with a forward speed meanwhile."""

    angle: float  # rad, left of the heading in the base's newest report
    v: float = 0.0  # m/s
    added: bool = False  # to the base's own goal instead (Motai's paper): such turns accumulate


Wish = Twist | WheelSpeeds | TurnBy


@dataclass(frozen=True, slots=True)
class LookAt:
    """Where a camera's head is to point, from its home position."""

    pan: float  # rad, left
    tilt: float = 0.0  # rad, up
    rate: float | None = None  # rad/s, left: of a goal that moves, to keep pace with


@dataclass(frozen=True, slots=True)
class Sonar:
    """One reading of a sonar disc."""

    disc: int
    pose: Pose2  # base_from_disc
    range: float  # m


class BatteryLevel(Enum):
    """What the base's battery allows; the thresholds are read from the base or configured."""

    UNKNOWN = "unknown"
    GOOD = "good"
    LOW = "low"  # say so
    WEAK = "weak"  # go slowly
    EMPTY = "empty"  # near the base's own shutdown: stop


@dataclass(frozen=True, slots=True)
class BaseInputs:
    """What else a base was asked to report; empty or None where nothing came yet."""

    encoders: tuple[int, int] | None = None  # ticks, left and right, since the base's start
    digital_in: bytes = b""
    digital_out: bytes = b""
    analog: tuple[float, ...] = ()  # V
    joystick: tuple[float, float] | None = None  # forward and left, -1..1
    buttons: tuple[bool, bool] = (False, False)  # of the joystick


@dataclass(frozen=True, slots=True)
class Odometry:
    """A status report of the base."""

    stamp: float  # s
    received: float  # s
    pose: Pose2  # odom_from_base
    twist: Twist
    wheel_stall: tuple[bool, bool] = (False, False)  # left, right
    bumpers_front: int = 0  # bit mask
    bumpers_rear: int = 0  # bit mask
    sonar: tuple[Sonar, ...] = ()  # new readings only
    battery: float = float("nan")  # V
    motors_enabled: bool = True
    stop_button: bool = False
    base_id: str = ""  # name / class / subclass
    battery_level: BatteryLevel = BatteryLevel.UNKNOWN
    charging: bool = False
    gyro: float = float("nan")  # rad/s, left, mean since the last report; nan = no gyro
    inputs: BaseInputs | None = None  # None = none asked for


@dataclass(frozen=True, slots=True)
class Chassis:
    """A base as it is known once connected, as far as the space and the time it needs go."""

    front: float  # m, from the wheels' axis
    rear: float  # m, positive
    half_width: float  # m
    track: float  # m, effective, between the wheels
    deceleration: float  # m/s^2, of a controlled stop
    turn_deceleration: float  # rad/s^2
    watchdog: float  # s, the base's own


@dataclass(frozen=True, slots=True)
class PtzState:
    """Where a camera's pan-tilt head points."""

    stamp: float  # s
    pan: float  # rad from the head's home position, left positive
    tilt: float  # rad, up positive
    zoom: float  # focal length over that at wide
    moving: bool  # turning, or about to


class TrackPhase(Enum):
    """Life of a track."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    OCCLUDED = "occluded"
    LOST = "lost"


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """A candidate in one image or scan."""

    stamp: float  # s
    score: float
    box: Box | None = None
    position: tuple[float, float] | None = None  # m, in `base`


@dataclass(frozen=True, slots=True, eq=False)
class TrackState:
    """What a tracker knows of its person. A lost track has neither box nor position."""

    stamp: float  # s, of the measurement it stands on
    phase: TrackPhase
    confidence: float  # 0..1, that this is the enrolled person
    frame_id: int | None = None  # Image.id it stands on
    box: Box | None = None
    bearing: float | None = None  # rad in `base` at `stamp`, left positive
    range: float | None = None  # m from `base` on the ground; None = unknown
    range_sigma: float | None = None  # m
    position: tuple[float, float] | None = None  # m, in `odom`
    velocity: tuple[float, float] | None = None  # m/s, in `odom`
    covariance: Array | None = None  # (2, 2) or (4, 4) of position (and velocity)
    by_legs: bool = False  # the laser alone carries it: the camera does not see the person
    candidates: tuple[Box, ...] = ()  # for drawing
    particles: Array | None = None  # (N, 2) px or m, for drawing
    # (N, 5) x, y, w, h px and likeness 0..1, nan = hidden or unknown; for drawing
    patches: Array | None = None


@dataclass(frozen=True, slots=True)
class Sight:
    """The direction in which an image showed the followed person."""

    stamp: float  # s, of the image
    pan: float  # rad in `odom`, left; without jumps while the person is in sight


VAGUE = 0.6  # m, of a place


@dataclass(frozen=True, slots=True)
class Place:
    """Where another sensor than the camera sees, or expects, the followed person."""

    distance: float  # m, from `base` on the ground
    bearing: float  # rad in `base`, left positive
    sigma: float = 0.0  # m, of either
    seen: bool = True  # False: hidden by somebody, where they should be by now
    refuted: bool = False  # what the tracker follows is not the person

    @property
    def vague(self) -> bool:
        """Whether it only says where the person was once: nothing to measure by."""
        return self.sigma > VAGUE


@dataclass(frozen=True, slots=True, eq=False)
class RobotPose:
    """Where the robot is on the map, as a localizer has it."""

    stamp: float  # s, of the scan it stands on
    map_from_base: Pose2
    map_from_odom: Pose2
    covariance: Array  # (3, 3) of x, y, theta of `map_from_base`
    lost: bool = False  # what is seen does not fit the map: not to be relied on


class StopReason(Enum):
    """Why the robot stands, or moves less than wished; the value is the text for people."""

    DISARMED = "not armed"
    HOLD = "held by the operator"
    ESTOP = "emergency stop pressed"
    START_UP = "waiting for all sensors to be fresh"
    NO_TARGET = "no person enrolled"
    NOT_CONFIRMED = "the enrolled person is not confirmed"
    SCAN_STALE = "laser data too old"
    IMAGE_STALE = "camera data too old"
    ODOMETRY_STALE = "base data too old"
    DECISION_STALE = "no fresh decision"
    ABSURD_DATA = "implausible data"
    TARGET_UNSURE = "not sure enough who is followed"
    TARGET_LOST = "person lost"
    RANGE_UNKNOWN = "distance to the person unknown"
    OBSTACLE = "obstacle in the way"
    PERSON_TOO_CLOSE = "person too close"
    REAR_UNSEEN = "no free space seen behind"
    WHEEL_STALL = "wheel stalled"
    BUMPER = "bumper pressed"
    MOTORS_OFF = "motors are off: press the white MOTORS button, then arm again"
    STOP_BUTTON = "STOP button pressed: release it, press MOTORS, then arm again"
    OPERATOR_GONE = "the operator who armed is gone: arm again"
    NO_DRIVING_HAND = "no hand on the controls"
    LINK_LOST = "device lost"
    DEVICE_REFUSED = "device refuses its set-up"
    LOOP_LATE = "the computer is too slow"
    LOW_BATTERY = "battery low"
    LIMIT = "speed or acceleration limit"
    SHUTDOWN = "followerd ends"


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason why a wish was changed: what, which device, and how much."""

    stop: StopReason
    device: str = ""
    detail: str = ""
    full_stop: bool = True  # False: slower than wished, not stopped

    def __str__(self) -> str:
        where = f" ({self.device})" if self.device else ""
        return f"{self.stop.value}{where}" + (f": {self.detail}" if self.detail else "")


@dataclass(frozen=True, slots=True)
class Command:
    """The last word before the wheels; only the guard makes one that moves.

    `motion` None is a controlled stop. The base keeps it until `expires`, then stops by itself.
    """

    stamp: float  # s, when it was decided
    motion: Wish | None = None
    expires: float = 0.0  # s; meaningless for a stop
    cause_received: float | None = None  # s, `received` of the measurement that caused it
    cause: str = ""  # stream of that measurement
    emergency: bool = False  # stop as hard as the base can
    reasons: tuple[Reason, ...] = ()

    @property
    def stops(self) -> bool:
        """Whether it asks for standstill."""
        return self.motion is None

    @property
    def speed(self) -> float:
        """Forward speed that it asks for, m/s."""
        return 0.0 if self.motion is None else self.motion.v


@dataclass(frozen=True, slots=True)
class Fault:
    """A device failed, or came back (`recovered`)."""

    stamp: float  # s
    device: str
    reason: StopReason
    detail: str = ""
    recovered: bool = False


class Mode(Enum):
    """What the robot is allowed to do."""

    DISARMED = "disarmed"
    READY = "ready"
    FOLLOWING = "following"
    HOLDING = "holding"
    SEARCHING = "searching"
    IDLE = "idle"
    MANUAL = "manual"
    FAULT = "fault"
    ESTOP = "estop"


@dataclass(frozen=True, slots=True)
class Decision:
    """What the pipeline made of one event."""

    sequence: int
    stamp: float  # s, now
    mode: Mode
    track: TrackState | None
    wish: Wish | None
    command: Command
    reasons: tuple[Reason, ...] = field(default=())  # all that hold now, the command's included
    motors: bool = False  # the wheels' motors are wanted on
    refused: str = ""  # why the operator's action was refused
    pose: RobotPose | None = None  # on the map, where there is a localizer
    look: LookAt | None = None  # for the camera's head; None = as before
    sight: Sight | None = None  # the newest; None = not in sight


Measurement = Image | Scan | Odometry | PtzState
