"""Every driver with its twin, on lines that are bad in every way."""

from collections import deque
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from math import hypot
from typing import Any, Protocol

import numpy as np

from followerd import clock
from followerd.geometry import Array, Camera, Pose2
from followerd.hw.camera.driver import CameraDriver
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.interfaces import Sensor
from followerd.hw.lms200.driver import Lms200
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.p2os import protocol as p2os
from followerd.hw.p2os.driver import P2osBase
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.vcc50i.driver import Vcc50i
from followerd.hw.vcc50i.settings import Vcc50iSettings
from followerd.messages import (
    Command,
    Image,
    Measurement,
    Odometry,
    Pixels,
    PtzState,
    Scan,
    Twist,
)
from followerd.sim import faults
from followerd.sim.faults import FaultKind
from followerd.sim.interfaces import Twin
from followerd.sim.line import Line
from followerd.sim.rig import mended_telegram
from followerd.sim.twins.camera import CameraTwin
from followerd.sim.twins.lms200 import Lms200Twin
from followerd.sim.twins.p2os import P2osTwin
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests.p2os_body import FloorBody

BOOT = 1.5  # s, of a device
MEMORY = 0.45  # s, how old what a bad line delivers may be
LATE = (FaultKind.DELAY, FaultKind.SLOW, FaultKind.SPLIT, FaultKind.DUPLICATE)


@dataclass(frozen=True, slots=True)
class BadLine:
    """What is wrong with a line."""

    name: str
    kind: FaultKind | None = None
    chunk: int = 62  # bytes that arrive together
    noise: bool = False  # between telegrams
    deaf: float = 0.0  # share of the host's chunks that do not arrive
    hurt: float = 0.0  # share of the host's chunks in which a byte is another
    mended: bool = True  # `wrong` has valid checksums


BAD_LINES = (
    *(BadLine(kind.value, kind) for kind in FaultKind),
    BadLine("one byte at a time", chunk=1),
    BadLine("garbage between telegrams", noise=True),
    BadLine("garbage inside telegrams", FaultKind.WRONG, mended=False),
    BadLine("commands lost", deaf=0.2),
    BadLine("commands garbled", hurt=0.2),
)


class Babbling:
    """A twin whose line is bad in ways that the simulation does not know, while it is told to."""

    def __init__(self, twin: Twin, line: BadLine, rng: np.random.Generator) -> None:
        self.twin = twin
        self.is_bad = False
        self._line = line
        self._rng = rng

    @property
    def baud(self) -> int:
        return self.twin.baud

    @baud.setter
    def baud(self, baud: int) -> None:
        self.twin.baud = baud

    def receive(self, data: bytes, now: float) -> None:
        if self.is_bad and self._rng.random() < self._line.deaf:
            return
        if self.is_bad and self._rng.random() < self._line.hurt:
            at = int(self._rng.integers(len(data)))
            data = data[:at] + self._rng.bytes(1) + data[at + 1 :]
        self.twin.receive(data, now)

    def step(self, now: float) -> bytes:
        burst = self.twin.step(now)
        if burst and self.is_bad and self._line.noise:
            return self._rng.bytes(int(self._rng.integers(1, 30))) + burst
        return burst

    def wake_at(self) -> float:
        return self.twin.wake_at()

    def reboot(self, now: float) -> None:
        self.twin.reboot(now)


class Specimen(Protocol):
    """A driver and its twin."""

    @property
    def sensor(self) -> Sensor:
        """The driver."""

    def fails(self, kind: FaultKind, length: float, share: float | None = None) -> None:
        """A fault begins."""

    def set_bad(self, bad: bool) -> None:
        """The line becomes bad, or good again, where that is no fault of the simulation."""

    def runs(self) -> Coroutine[Any, Any, None]:
        """The twin's side, for ever."""

    def use(self, armed: bool) -> None:
        """What the daemon does with the device all the time."""

    def untrue(self, measured: Measurement, line: BadLine) -> str:
        """What is wrong with a measurement; nothing if it is true."""

    def at_rest(self) -> bool:
        """Whether nothing moves."""


class OnLine:
    """What specimens on a serial line have in common."""

    def __init__(
        self, device: str, twin: Twin, line: BadLine, seed: int, mend: faults.Mend
    ) -> None:
        self.device = device
        line_rng, noise_rng = np.random.default_rng([seed, 1]).spawn(2)
        self._babbling = Babbling(twin, line, noise_rng)
        mend = mend if line.mended else bytes
        self.line = Line(self._babbling, line_rng, device, line.chunk, mend=mend)

    def fails(self, kind: FaultKind, length: float, share: float | None = None) -> None:
        self.line.inject(faults.Fault(self.device, kind, self.line.elapsed, length, share))

    def set_bad(self, bad: bool) -> None:
        self._babbling.is_bad = bad

    def runs(self) -> Coroutine[Any, Any, None]:
        return self.line.run()

    def use(self, armed: bool) -> None:
        """Sensors are only listened to."""

    def at_rest(self) -> bool:
        return True


class Base(OnLine):
    """The base drives a circle as long as it is armed."""

    def __init__(self, line: BadLine, seed: int) -> None:
        self.body = FloorBody()
        twin = P2osTwin(self.body, np.random.default_rng(seed))
        super().__init__("robot", twin, line, seed, p2os.with_checksum)
        self.sensor = self.base = P2osBase(P2osSettings(), self.line.link)
        self._true: list[tuple[float, Pose2, float]] = []
        self._last: Odometry | None = None
        self._armed = False

    def use(self, armed: bool) -> None:
        now = clock.now()
        self._true.append((now, self.body.pose, sum(self.body.speeds) / 2))
        if armed is not self._armed:
            self._armed = armed
            self.base.enable_motors(armed)
        if armed:
            self.base.drive(Command(now, Twist(0.2, 0.2), now + 0.25))

    def untrue(self, measured: Measurement, line: BadLine) -> str:
        assert isinstance(measured, Odometry)
        last, self._last = self._last, measured
        if last is None or measured.stamp - last.stamp > MEMORY:
            return ""  # a new session: what moved meanwhile it cannot know
        memory = MEMORY if line.kind in LATE else 0.15
        speeds = [v for t, _, v in self._true if -memory < t - measured.stamp < 0.1]
        went = hypot(measured.pose.x - last.pose.x, measured.pose.y - last.pose.y)
        farthest = max(speeds, default=0.0) * (measured.stamp - last.stamp + memory) + 0.01
        if went > farthest:
            return f"went {went:.3f} m, could have gone {farthest:.3f} m"
        if speeds and not min(speeds) - 0.03 <= measured.twist.v <= max(speeds) + 0.03:
            return f"speed {measured.twist.v} m/s, really {min(speeds)} to {max(speeds)}"
        return ""

    def at_rest(self) -> bool:
        return self.body.is_still


class Hall:
    """Walls at a distance that only depends on where one looks; a picture that tells the time."""

    def __init__(self) -> None:
        self.now = 0.0
        self.measured_at: deque[float] = deque(maxlen=20)  # first beams of the newest scans, s

    def advance(self, now: float) -> None:
        self.now = now

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        self.measured_at.append(self.now - float(ages.max()))
        return wall(bearings)

    def render(self, camera: Camera) -> Pixels:
        return picture(self.now, camera)


def wall(bearings: Array) -> Array:
    """True ranges, m."""
    ranges: Array = 4.0 + np.sin(3.0 * bearings)
    return ranges


def picture(stamp: float, camera: Camera) -> Pixels:
    """What the camera sees at a time."""
    columns = np.arange(camera.width) + round(1000 * stamp)
    row = (columns % 251).astype(np.uint8)[None, :, None]
    return np.ascontiguousarray(np.broadcast_to(row, (camera.height, camera.width, 3)))


class Laser(OnLine):
    """The laser in a hall."""

    def __init__(self, line: BadLine, seed: int) -> None:
        self._hall = Hall()
        twin = Lms200Twin(self._hall, np.random.default_rng(seed), Pose2(), boot_time=BOOT)
        super().__init__("laser", twin, line, seed, mended_telegram)
        self.sensor = Lms200(Lms200Settings(baud=38400, resolution_deg=1), self.line.link)

    def untrue(self, measured: Measurement, line: BadLine) -> str:
        assert isinstance(measured, Scan)
        seen = np.isfinite(measured.ranges)
        error = np.abs(measured.ranges - wall(measured.angles))[seen]
        if error.max(initial=0.0) > 0.12:
            return f"off by {error.max():.2f} m"
        late = min(abs(measured.stamp - time) for time in self._hall.measured_at)
        allowed = 0.012 if line.noise else 0.004  # noise takes its line time
        return f"stamp {late:.3f} s off" if late > allowed and line.kind not in LATE else ""


class Ptz(OnLine):
    """The camera's head is asked to look to and fro; it moves nobody."""

    def __init__(self, line: BadLine, seed: int) -> None:
        twin = Vcc50iTwin(np.random.default_rng(seed), knows_home=True)
        super().__init__("ptz", twin, line, seed, bytes)
        self.sensor = self.head = Vcc50i(Vcc50iSettings(), self.line.link)

    def use(self, armed: bool) -> None:
        self.head.look(0.5 * (-1) ** int(clock.now()), 0.0)

    def untrue(self, measured: Measurement, line: BadLine) -> str:
        assert isinstance(measured, PtzState)
        return "" if abs(measured.pan) < 1.8 and abs(measured.tilt) < 1.6 else "beyond its stops"


class Eye:
    """The camera in a hall."""

    def __init__(self, line: BadLine, seed: int) -> None:
        settings = CameraSettings(width=64, height=48, rate_hz=10)
        self.twin = CameraTwin(Hall(), settings.camera, 10.0, np.random.default_rng(seed))
        self.sensor = CameraDriver(settings, self.twin.link)

    def fails(self, kind: FaultKind, length: float, share: float | None = None) -> None:
        self.twin.inject(faults.Fault("camera", kind, self.twin.elapsed, length, share))

    def set_bad(self, bad: bool) -> None:
        """A camera delivers whole frames, and hears nothing."""

    def runs(self) -> Coroutine[Any, Any, None]:
        return self.twin.run()

    def use(self, armed: bool) -> None:
        """Only looked through."""

    def untrue(self, measured: Measurement, line: BadLine) -> str:
        assert isinstance(measured, Image)
        same = np.array_equal(measured.pixels, picture(measured.stamp, measured.camera))
        return "" if same else "another picture than at its time"

    def at_rest(self) -> bool:
        return True


SPECIMENS: dict[str, Callable[[BadLine, int], Specimen]] = {
    "base": Base,
    "laser": Laser,
    "camera": Eye,
    "ptz": Ptz,
}
# what no check can tell from the truth: valid telegrams that lie, and lines without checksums
LIARS = {
    "base": {FaultKind.WRONG, FaultKind.STUCK},
    "laser": {FaultKind.WRONG},
    "camera": {
        *(FaultKind.WRONG, FaultKind.STUCK, FaultKind.GARBAGE, FaultKind.FLIP, FaultKind.SPLIT),
    },
    "ptz": {FaultKind.WRONG, FaultKind.FLIP, FaultKind.GARBAGE, FaultKind.DROP},
}


def is_excused(device: str, line: BadLine) -> bool:
    """Whether nobody could tell what comes over this line from the truth."""
    return line.kind in LIARS[device] and (line.mended or device in ("camera", "ptz"))
