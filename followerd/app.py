"""The composition root: which driver, or which twin, is plugged into the daemon. Read it first."""

import gc
import signal
import sys
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass, replace
from math import radians
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from followerd import clock
from followerd.config import SIM, Config
from followerd.control.registry import CONTROLLERS
from followerd.errors import ConfigError
from followerd.estimation.localizer import Localizer
from followerd.estimation.registry import LOCALIZERS
from followerd.geometry import Pose2
from followerd.hw.camera.settings import CameraSettings
from followerd.hw.camera.source import FrameSource
from followerd.hw.interfaces import Base, PanTilt, Sensor
from followerd.hw.lms200.settings import (
    Lms200Settings,
    delivered_period,
    oldest,
    stale_after,
    under_way,
)
from followerd.hw.p2os.writer import HALT
from followerd.hw.registry import DRIVERS
from followerd.hw.serial import open_link
from followerd.hw.stream import Link
from followerd.hw.vcc50i.protocol import BAUD
from followerd.maps.floor import FloorMap
from followerd.maps.source import open_map
from followerd.messages import Box
from followerd.pipeline import Pipeline, PipelineSettings
from followerd.runtime.auto_operator import AutoOperator
from followerd.runtime.control_socket import default_path, serve
from followerd.runtime.cut_link import CutLink
from followerd.runtime.daemon import Daemon
from followerd.runtime.heartbeat import Heartbeat
from followerd.runtime.notify import Notify
from followerd.runtime.overheard import Hear, OverheardLink
from followerd.runtime.shadows import Shadows
from followerd.sim import scenarios
from followerd.sim.faults import Fault
from followerd.sim.rig import Equipment, Rig
from followerd.sim.stereo_pair import PairGeometry
from followerd.sim.survey import surveyed
from followerd.streams import STREAMS
from followerd.trackers.interfaces import MapTracker, Tracker
from followerd.trackers.registry import TRACKERS

SWITCH = 0.0005  # s that the loop waits for the interpreter while a thread looks at an image
DRIVE_LAG = 0.15  # s from a command to braking wheels
DEFAULT_TWIN = "p3dx-sh"  # what the base's twin is where the config names no model
DEFAULT_HEAD = "vc-c50i"
AUX = "aux"  # link of a head on the base's AUX port
LOCATED = ("kind", "map", "start_pose")  # what a localizer's section says beyond its settings

Attach = Callable[[Daemon], None]
Beside = Callable[[Daemon], Coroutine[Any, Any, None]]  # what runs as long as the daemon does


@dataclass(frozen=True, slots=True)
class Plugs:
    """Where the devices are plugged in."""

    base: Link
    laser: Link
    camera: FrameSource
    ptz: Link | None = None  # None = no head, or one on the base's AUX port


def hardware(config: Config) -> Plugs:
    """The links that the config names."""
    from followerd.hw.camera.sources import open_camera  # twins need no camera's library

    return Plugs(
        open_link(config.base.link),
        open_link(config.laser.link),
        open_camera(config.camera.link, _camera(config)),
        None if config.ptz is None or config.ptz.link == AUX else open_link(config.ptz.link),
    )


def in_memory(rig: Rig) -> Plugs:
    """The twins of a rig in this process."""
    ptz = None if rig.ptz is None else rig.ptz.link
    return Plugs(rig.robot.link, rig.laser.link, rig.camera.link, ptz)


def plugged_into(config: Config, folder: Path) -> Config:
    """The config with every `sim` link replaced by what `followerd sim --links` offers there."""
    places = {"base": "robot", "laser": "laser", "camera": "camera", "ptz": "ptz"}
    links = {
        role: section.model_copy(update={"link": str(folder / place)})
        for role, place in places.items()
        if (section := getattr(config, role)) is not None and section.link == "sim"
    }
    return config.model_copy(update=links)


def build(config: Config, plugs: Plugs) -> Daemon:
    """The daemon of a config; to be called in its event loop."""
    # measurements and decisions hold no cycles; looking for them often costs a fifth of the time
    gc.set_threshold(50_000, 20, 100)
    verify(config)
    tracker, pipeline = thinking(config)
    overheard: list[Hear] = []
    if config.record.raw_bytes:
        plugs = _overheard(plugs, overheard)
    base = DRIVERS.load(config.base.kind)(config.base, plugs.base)
    daemon = Daemon(
        base,
        laser_and_camera(config, plugs),
        tracker,
        pipeline,
        config.image_work_s,
        _head(config, plugs, base),
        _shadows(config),
        heads=config.tracker.kind == "head",
    )
    daemon.line_watchers = overheard
    return daemon


def _overheard(plugs: Plugs, watchers: list[Hear]) -> Plugs:
    def hear(device: str, data: bytes, now: float) -> None:
        for watch in watchers:
            watch(device, data, now)

    return replace(
        plugs,
        base=OverheardLink(plugs.base, "base", hear),
        laser=OverheardLink(plugs.laser, "laser", hear),
        ptz=None if plugs.ptz is None else OverheardLink(plugs.ptz, "ptz", hear),
    )


def thinking(config: Config) -> tuple[Tracker, Pipeline]:
    """What a daemon thinks with, and a replay again."""
    cv2.setNumThreads(1)
    tracker = TRACKERS.load(config.tracker.kind)(config.tracker, np.random.default_rng(config.seed))
    floor = floor_of(config)
    if floor is not None and isinstance(tracker, MapTracker):
        tracker.enter(floor)
    controller = CONTROLLERS.load(config.controller.kind)(config.controller)
    return tracker, Pipeline(
        pipeline_settings(config),
        controller,
        np.random.default_rng([config.seed, 2]),
        _localizer(config, floor),
        tracker.needs,
        None if floor is None else floor.walls,
    )


def _shadows(config: Config) -> Shadows | None:
    """With the predictor that is listened to first among them, to compare."""
    if not config.shadow:
        return None
    settings = config.pipeline.foresight
    kinds = tuple(dict.fromkeys((settings.predictor, *config.shadow)))
    return Shadows(kinds, settings, np.random.default_rng([config.seed, 3]))


def verify(config: Config) -> None:
    """Raise ConfigError where parts that are good by themselves do not go together."""
    pipeline_settings(config)
    _verify_head(config)
    tracker = TRACKERS.load(config.tracker.kind)
    if "pose" in tracker.needs and config.localizer is None:
        raise ConfigError(
            f"tracker: {config.tracker.kind} thinks on a map; add a localizer section"
        )
    floor_of(config)
    if "image" not in tracker.needs:
        return
    seen, wanted = _camera(config).sees, tracker.sees
    if seen not in wanted:
        raise ConfigError(
            f"tracker: {config.tracker.kind} needs a camera for {' or '.join(sorted(wanted))};"
            f" {config.camera.kind} gives {seen} images"
        )


def _verify_head(config: Config) -> None:
    if getattr(config.controller, "head", False) and config.ptz is None:
        raise ConfigError("controller: head: true needs a pan-tilt head; add a ptz section")


def laser_and_camera(config: Config, plugs: Plugs) -> tuple[Sensor, Sensor]:
    """The sensors that see a person, without a daemon."""
    laser = DRIVERS.load(config.laser.kind)(config.laser, plugs.laser)
    return laser, DRIVERS.load(config.camera.kind)(config.camera, plugs.camera)


def for_drive_check(config: Config, plugs: Plugs) -> tuple[Base, Sensor, CutLink]:
    """Base and laser alone, and the base's link, which the check cuts once."""
    link = CutLink(plugs.base, HALT)
    base = DRIVERS.load(config.base.kind)(config.base, link)
    return base, DRIVERS.load(config.laser.kind)(config.laser, plugs.laser), link


def _head(config: Config, plugs: Plugs, base: Base) -> PanTilt | None:
    """The camera's head, if there is one. Raises ConfigError when the base has no AUX port."""
    if config.ptz is None:
        return None
    link = plugs.ptz
    if config.ptz.link == AUX:
        aux_link: Callable[[], Link] | None = getattr(base, "aux_link", None)
        if aux_link is None:
            raise ConfigError(f"ptz: a {config.base.kind} base has no AUX port; give its own link")
        link = aux_link()
    head: PanTilt = DRIVERS.load(config.ptz.kind)(config.ptz, link)
    return head


def pipeline_settings(config: Config) -> PipelineSettings:
    """The config's, with what follows from the laser's rate.

    Raises ConfigError when the laser is too slow to drive by.
    """
    laser, settings = laser_settings(config), config.pipeline
    limit, more, most = stale_after(laser), under_way(laser), STREAMS["scan"].stale_after
    if limit + more > most:
        raise ConfigError(
            f"laser: {laser.variant.count} values at {laser.baud} baud come every"
            f" {delivered_period(laser):.2f} s, too slow to drive by;"
            " use resolution_deg: 1, field_deg: 100 or a higher baud"
        )
    limits = {"scan": limit, **settings.stale_after_s}
    longer = {"scan": more, **settings.under_way_s}
    reaction = max(settings.guard.reaction_s, oldest(laser) + DRIVE_LAG)
    guard = settings.guard.model_copy(update={"reaction_s": reaction})
    known = {"stale_after_s": limits, "under_way_s": longer, "guard": guard}
    return settings.model_copy(update=known)


def floor_of(config: Config) -> FloorMap | None:
    """The map of the localizer's section; raises ConfigError."""
    if config.localizer is None:
        return None
    if config.localizer.map == SIM:
        scenario = scenarios.load(config.sim.scenario)
        return surveyed(scenario, np.random.default_rng([config.seed, 3]))
    return open_map(Path(config.localizer.map))


def _localizer(config: Config, floor: FloorMap | None) -> Localizer | None:
    """Started where the config says."""
    section = config.localizer
    if section is None or floor is None:
        return None
    kind = LOCALIZERS.load(section.kind)
    settings = kind.Settings.model_validate(section.model_dump(exclude=set(LOCATED)))
    localizer: Localizer = kind(settings, floor, np.random.default_rng([config.seed, 4]))
    at = section.start_pose
    if at is not None:
        localizer.start(Pose2(at.x_m, at.y_m, radians(at.yaw_deg)))
    elif section.map == SIM:
        robot = scenarios.load(config.sim.scenario).robot
        localizer.start(Pose2(robot.x_m, robot.y_m, radians(robot.yaw_deg)))
    else:
        localizer.start(None)
    return localizer


def rig(config: Config, faults: Sequence[Fault] = ()) -> Rig:
    """The simulated robot that fits a config; `faults` come besides the config's own."""
    own = [Fault.parse(text) for text in config.sim.faults]
    scenario = scenarios.load(config.sim.scenario)
    return Rig(scenario, equipment(config), config.seed, [*own, *faults])


def equipment(config: Config) -> Equipment:
    """What a config says of the robot's build."""
    laser, camera = laser_settings(config), _camera(config)
    return Equipment(
        getattr(config.base, "model", None) or DEFAULT_TWIN,
        laser.mount.base_from_laser,
        laser.mount.upside_down,
        camera.camera,
        camera.rate_hz,
        camera.sees,
        config.camera.kind == "kinect",
        _pair(camera),
        getattr(config.ptz, "model", None) or DEFAULT_HEAD,
        getattr(config.ptz, "baud", None) or BAUD,
        config.ptz is not None and config.ptz.link == AUX,
    )


def laser_settings(config: Config) -> Lms200Settings:
    """Its section without the link."""
    return Lms200Settings.model_validate(config.laser.model_dump(exclude={"kind", "link"}))


def _camera(config: Config) -> CameraSettings:
    kind: type[CameraSettings] = DRIVERS.load(config.camera.kind).Settings
    return kind.model_validate(config.camera.model_dump(exclude={"kind", "link"}))


def _pair(camera: CameraSettings) -> PairGeometry | None:
    """How a stereo camera's twin is built."""
    if camera.sees != "depth":
        return None
    from followerd.hw.camera.stereo import StereoSettings  # few configs need its library

    if not isinstance(camera, StereoSettings):
        return None
    return PairGeometry(camera.rectification.baseline, camera.nearest_m, camera.shrink)


async def live(
    config: Config, duration: float | None, attach: Attach, beside: Sequence[Beside] = ()
) -> Daemon:
    """Run the daemon on the config's links, until `duration` has passed or a signal comes."""
    sys.setswitchinterval(SWITCH)
    plugs, heartbeat = hardware(config), Heartbeat(HALT)
    daemon = build(config, replace(plugs, base=heartbeat.guarded(plugs.base)))
    attach(daemon)
    path = Path(config.socket) if config.socket else default_path()
    others = [part(daemon) for part in beside]
    own = heartbeat.run(), Notify().run(daemon), serve(daemon, path)
    parts = clock.together(*own, *_parts(daemon, config), *others)
    await clock.until_signal(parts, signal.SIGTERM, signal.SIGINT, seconds=duration)
    return daemon


async def virtual(config: Config, duration: float, attach: Attach, world: Rig) -> Daemon:
    """Run the daemon on the twins of `world` in this process; the loop must be virtual."""
    daemon = build(config, in_memory(world))
    daemon.vision.develop = world.camera.develop
    attach(daemon)
    await clock.within(duration, clock.together(world.run(), *_parts(daemon, config)))
    return daemon


def _parts(daemon: Daemon, config: Config) -> list[Coroutine[Any, Any, None]]:
    if config.operator == "manual":
        return [daemon.run()]
    region = None if config.enrol_px is None else Box(*config.enrol_px)
    arm, heads = config.operator == "auto", config.tracker.kind == "head"
    operator = AutoOperator(daemon, region, arm=arm, heads=heads)
    return [operator.run(), daemon.run()]
