"""A target that goes around a robot of twins, seen as Motai's three are: true but for the noise.

Base, camera head, their drivers and lines, the pipeline and its guard are whole. Only the sensors
that do not matter here are replaced: the laser sees an empty hall, the camera knows where the
target's column is, up to jitter, sway, wrong looks and whole pixels.
"""

from collections.abc import Callable
from math import atan2, inf, radians

import numpy as np

from followerd import clock
from followerd.bench.motai_target import looks
from followerd.estimation.foresight import Foresight, ForesightSettings
from followerd.geometry import Array, Camera, Pose2, wrap_angle
from followerd.hw.interfaces import Sink
from followerd.messages import (
    Box,
    Image,
    Odometry,
    Place,
    Scan,
    TrackPhase,
    TrackState,
)
from followerd.sim.rig import Rig

PERIOD = 1 / 15  # s
READOUT = 0.02  # s
SCAN_PERIOD = 0.1  # s
IMAGES = 400  # looks that are drawn: more than a run has
SIDE = 40.0  # px of the target


class Stage:
    """Where the target really is, seen from the simulated robot."""

    def __init__(self, rig: Rig, camera: Camera) -> None:
        self._rig = rig
        self._camera = camera

    def direction(self, time: float) -> float:
        """Of the target at `time`, s, in the world, rad, from where the robot stands."""
        world = self._rig.world
        motion = world.walkers[0].at(time)
        return atan2(motion.y - world.pose.y, motion.x - world.pose.x)

    @property
    def heading(self) -> float:
        """Of the robot now, in the world, rad."""
        return self._rig.world.pose.theta

    def aim(self) -> float:
        """Of the camera now, in the world, rad."""
        return self._rig.world.pose.theta + self._rig.head.aimed(self._camera, clock.now()).yaw

    def off(self) -> float:
        """How far the target is now from the camera's axis, rad, left positive."""
        self._rig.world.advance(clock.now())
        return wrap_angle(self.direction(clock.now()) - self.aim())


class Eye:
    """Camera and tracker in one: the target's column in each image, or nothing."""

    name = "camera"
    needs = frozenset({"image"})
    sees = frozenset({"thermal"})

    def __init__(self, stage: Stage, camera: Camera, target: str, rng: np.random.Generator) -> None:
        self._stage = stage
        self._camera = camera
        self._target = target
        self._rng = rng
        self._columns: dict[int, float | None] = {}

    async def run(self, sink: Sink) -> None:
        """See hw.interfaces.Sensor."""
        began, k = clock.now(), 0
        noise = self._noise(began)
        while True:
            stamp = clock.now()
            off = self._stage.off() + float(noise[k % noise.size])
            self._columns[k] = self._column(off)
            await clock.sleep_until(stamp + READOUT)
            picture = np.full((1, 1), k % 251, np.uint8)  # no two alike, as a real camera's
            sink(Image(k, stamp, clock.now(), picture, self._camera))
            k += 1
            await clock.sleep_until(began + k * PERIOD)

    def _noise(self, began: float) -> Array:
        """What is added to the target's direction in each image, rad: the other heat source, as in
        the open loop, stands still."""
        times = began + PERIOD * np.arange(IMAGES)
        true = np.degrees(np.unwrap([self._stage.direction(time) for time in times]))
        noise: Array = np.radians(looks(self._rng, true, self._target) - true)
        return noise

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """See Tracker: it knows whom."""
        del region, ego
        assert isinstance(seen, Image)
        return self._state(seen)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        """See Tracker."""
        del ego, place
        assert isinstance(measurement, Image)
        return self._state(measurement)

    def forget(self) -> None:
        """See Tracker."""

    def _column(self, off: float) -> float | None:
        column = float(round(self._camera.column(self._camera.yaw + off)))
        return column if abs(off) < 1.5 and 0.0 <= column < self._camera.width else None

    def _state(self, image: Image) -> TrackState:
        column = self._columns.get(image.id)
        if column is None:
            return TrackState(image.stamp, TrackPhase.OCCLUDED, 0.5, image.id)
        box = Box.around(column + 0.5, 0.5 * image.camera.height, SIDE, SIDE)
        bearing = image.camera.bearing(column)
        return TrackState(
            image.stamp, TrackPhase.CONFIRMED, 1.0, image.id, box=box, bearing=bearing
        )


class Hall:
    """A laser that sees nothing near."""

    name = "laser"

    async def run(self, sink: Sink) -> None:
        """See hw.interfaces.Sensor."""
        ranges, times = np.full(181, inf), np.zeros(181)
        step = radians(1.0)
        while True:
            stamp = clock.now()
            await clock.sleep(SCAN_PERIOD)
            now = clock.now()
            sink(Scan(stamp, now, radians(-90.0), step, ranges, 8.0, times, Pose2()))


class Oracle(Foresight):
    """Foresees the truth, in the robot's own odometry."""

    def __init__(
        self,
        settings: ForesightSettings,
        rng: np.random.Generator,
        stage: Stage,
        ego_at: Callable[[float], Pose2 | None],
    ) -> None:
        super().__init__(settings, rng)
        self._stage = stage
        self._ego_at = ego_at

    def at(self, stamp: float) -> float | None:
        """See Foresight."""
        ego = self._ego_at(clock.now())
        drift = 0.0 if ego is None else ego.theta - self._stage.heading
        return self._stage.direction(stamp) + drift
