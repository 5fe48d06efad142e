"""One robot's twins in one world: base, laser, camera and its head, each on its line."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from followerd import clock
from followerd.errors import UsageError
from followerd.geometry import Camera, Pose2
from followerd.hw.lms200 import protocol as lms200
from followerd.hw.p2os import protocol as p2os
from followerd.hw.p2os.models import MODELS, Model
from followerd.hw.vcc50i.protocol import well_formed
from followerd.sim.faults import DEVICES, Fault
from followerd.sim.line import Line
from followerd.sim.scenarios import Scenario
from followerd.sim.stereo_pair import PairGeometry, StereoPair
from followerd.sim.structured_light import StructuredLight
from followerd.sim.truth import Truth
from followerd.sim.twins.camera import CameraTwin, Sight
from followerd.sim.twins.lms200 import Lms200Twin
from followerd.sim.twins.p2os import P2osTwin
from followerd.sim.twins.vcc50i import Vcc50iTwin
from followerd.sim.world import World

Sees = Literal["colour", "depth", "thermal"]

TRUTH_PERIOD = 0.05  # s
NO_LINE = "the head is on the base's AUX port and has no line of its own: let the robot fail"


@dataclass(frozen=True, slots=True)
class Equipment:
    """What stands on the robot, and where."""

    base_model: str  # subtype as P2OS names it
    base_from_laser: Pose2
    laser_upside_down: bool
    camera: Camera
    camera_rate: float  # Hz
    camera_sees: Sees = "colour"
    camera_structured_light: bool = False  # its depth is a Kinect's
    camera_pair: PairGeometry | None = None  # its depth is a stereo pair's; else it is exact
    ptz_model: str = "vc-c50i"
    ptz_baud: int = 9600
    ptz_on_aux: bool = False  # of the base; else it has a line of its own


def _sight(world: World, equipment: Equipment, rng: np.random.Generator) -> Sight:
    sees = equipment.camera_sees
    if equipment.camera_structured_light:
        return Sight(StructuredLight(rng).of(world), depth=True)
    if equipment.camera_pair is not None:
        return Sight(StereoPair(equipment.camera_pair, rng).of(world), depth=True)
    if sees == "thermal":
        return Sight(lambda camera: (world.thermal(camera), None), channels=1)
    if sees == "depth":
        return Sight(lambda camera: (world.render(camera), world.depth(camera)), depth=True)
    return Sight(lambda camera: (world.render(camera), None))


class Rig:
    """The world and the twins; `truths` grows while it runs."""

    def __init__(
        self, scenario: Scenario, equipment: Equipment, seed: int, faults: Sequence[Fault] = ()
    ) -> None:
        rngs = np.random.default_rng([seed, 7]).spawn(6)
        world_rng, robot_rng, laser_rng, camera_rng, ptz_rng, depth_rng = rngs
        self.world = World(_on_wheels(scenario, MODELS[equipment.base_model]), world_rng)
        base = P2osTwin(self.world, robot_rng, model=equipment.base_model)
        scanner = Lms200Twin(
            self.world,
            laser_rng,
            equipment.base_from_laser,
            upside_down=equipment.laser_upside_down,
        )
        of = {device: tuple(f for f in faults if f.device == device) for device in DEVICES}
        self.base = base
        self.robot = Line(base, robot_rng, "robot", faults=of["robot"], mend=p2os.with_checksum)
        self.laser = Line(scanner, laser_rng, "laser", faults=of["laser"], mend=mended_telegram)
        self.head = Vcc50iTwin(  # on since an earlier run
            ptz_rng, model=equipment.ptz_model, baud=equipment.ptz_baud, knows_home=True
        )
        self.ptz: Line | None = None  # of the head, unless it is on the base's AUX port
        if equipment.ptz_on_aux:
            if of["ptz"]:
                raise UsageError(NO_LINE)
            base.attach_aux(self.head)
        else:
            self.ptz = Line(self.head, ptz_rng, "ptz", faults=of["ptz"], mend=well_formed)
        self.camera = CameraTwin(
            self.world,
            equipment.camera,
            equipment.camera_rate,
            camera_rng,
            of["camera"],
            self.head.aimed,
            _sight(self.world, equipment, depth_rng),
        )
        self.truths: list[Truth] = []

    async def run(self) -> None:
        """Let the world go on, for ever."""
        self.world.advance(clock.now())
        lines = [line.run() for line in (self.robot, self.laser, self.ptz) if line is not None]
        await clock.together(*lines, self.camera.run(), self._watch())

    def inject(self, text: str) -> Fault:
        """A fault while it runs, at once unless it has a start; raises UsageError."""
        elapsed = self.robot.elapsed
        fault = Fault.parse(text, elapsed)
        if fault.end <= elapsed:
            raise UsageError(f"fault {text!r} is over: the simulation is at {elapsed:.1f} s")
        twins: dict[str, Line | CameraTwin | None] = {
            "robot": self.robot, "laser": self.laser, "camera": self.camera, "ptz": self.ptz,
        }  # fmt: skip
        twin = twins[fault.device]
        if twin is None:
            raise UsageError(NO_LINE)
        twin.inject(fault)
        return fault

    async def _watch(self) -> None:
        while True:
            self.world.advance(clock.now())
            self.truths.append(self.world.truth())
            await clock.sleep(TRUTH_PERIOD)


def mended_telegram(burst: bytes) -> bytes:
    """A laser's telegram with its checksum made right; acknowledgements have none."""
    is_telegram = lms200.OVERHEAD < len(burst) <= lms200.LONGEST_PAYLOAD + lms200.OVERHEAD
    return lms200.with_checksum(burst) if is_telegram else burst


def _on_wheels(scenario: Scenario, model: Model) -> Scenario:
    """The scenario with the model's wheel track, unless it has one of its own."""
    if "track_m" in scenario.robot.model_fields_set:
        return scenario
    robot = scenario.robot.model_copy(update={"track_m": 2 * model.half_track})
    return scenario.model_copy(update={"robot": robot})
