"""One robot's twins in one world: base, laser and camera, each on its line."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from followerd import clock
from followerd.errors import UsageError
from followerd.geometry import Camera, Pose2
from followerd.hw.p2os.models import MODELS, Model
from followerd.sim.faults import Fault
from followerd.sim.line import Line
from followerd.sim.scenarios import Scenario
from followerd.sim.truth import Truth
from followerd.sim.twins.camera import CameraTwin
from followerd.sim.twins.lms200 import Lms200Twin
from followerd.sim.twins.p2os import P2osTwin
from followerd.sim.world import World

TRUTH_PERIOD = 0.05  # s
DEVICES = ("robot", "laser", "camera")


@dataclass(frozen=True, slots=True)
class Equipment:
    """What stands on the robot, and where."""

    base_model: str  # subtype as P2OS names it
    base_from_laser: Pose2
    laser_upside_down: bool
    camera: Camera
    camera_rate: float  # Hz


class Rig:
    """The world and the twins; `truths` grows while it runs."""

    def __init__(
        self, scenario: Scenario, equipment: Equipment, seed: int, faults: Sequence[Fault] = ()
    ) -> None:
        for fault in faults:
            if fault.device not in DEVICES:
                raise UsageError(f"no device {fault.device!r}; there are {', '.join(DEVICES)}")
        world_rng, robot_rng, laser_rng, camera_rng = np.random.default_rng([seed, 7]).spawn(4)
        self.world = World(_on_wheels(scenario, MODELS[equipment.base_model]), world_rng)
        base = P2osTwin(self.world, robot_rng, model=equipment.base_model)
        scanner = Lms200Twin(
            self.world,
            laser_rng,
            equipment.base_from_laser,
            upside_down=equipment.laser_upside_down,
        )
        of = {device: tuple(f for f in faults if f.device == device) for device in DEVICES}
        self.robot = Line(base, robot_rng, "robot", faults=of["robot"])
        self.laser = Line(scanner, laser_rng, "laser", faults=of["laser"])
        self.camera = CameraTwin(
            self.world, equipment.camera, equipment.camera_rate, camera_rng, of["camera"]
        )
        self.truths: list[Truth] = []

    async def run(self) -> None:
        """Let the world go on, for ever."""
        self.world.advance(clock.now())
        await clock.together(self.robot.run(), self.laser.run(), self.camera.run(), self._watch())

    async def _watch(self) -> None:
        while True:
            self.world.advance(clock.now())
            self.truths.append(self.world.truth())
            await clock.sleep(TRUTH_PERIOD)


def _on_wheels(scenario: Scenario, model: Model) -> Scenario:
    """The scenario with the model's wheel track, unless it has one of its own."""
    if "track_m" in scenario.robot.model_fields_set:
        return scenario
    robot = scenario.robot.model_copy(update={"track_m": 2 * model.half_track})
    return scenario.model_copy(update={"robot": robot})
