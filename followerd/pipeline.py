"""One event in, one decision out: pure, so robot, simulation and replay run the same."""

from collections.abc import Collection
from math import hypot, inf

import numpy as np
import numpy.typing as npt
from pydantic import Field, NonNegativeFloat, PositiveFloat

from followerd.control.freshness import Freshness, StreamName
from followerd.control.guard import Guard, Situation
from followerd.control.interfaces import Controller, HeadController, Scene, Target, View
from followerd.control.limits import GuardSettings
from followerd.control.mode import Modes, ModeSettings, Permission
from followerd.control.transitions import Action
from followerd.estimation.association import Association, AssociationSettings
from followerd.estimation.ego_motion import EgoMotion, EgoMotionSettings
from followerd.estimation.foresight import Foresight, ForesightSettings
from followerd.estimation.localizer import Localizer
from followerd.estimation.ranging import Person
from followerd.events import Coming, Event, Hand, Late, Operator, Presence, Tracked
from followerd.geometry import Array, Pose2
from followerd.messages import (
    Chassis,
    Clusters,
    Decision,
    Fault,
    LookAt,
    Mode,
    Odometry,
    Place,
    RobotPose,
    Scan,
    TrackPhase,
    TrackState,
    Twist,
    Wish,
)
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.perception.foreground import on_walls
from followerd.settings import Settings

SEEN = (TrackPhase.TENTATIVE, TrackPhase.CONFIRMED)
CAMERA = "camera"  # a device that only shows, where the tracker needs no images
JUMP = 0.5  # m, between two scans: who thinks on the map stops
BLIND = 0.5  # s between two scans, after which odometry may have missed some of the way
DRIVEN_BY = frozenset({"scan", "odometry"})  # streams without which nothing drives


class PipelineSettings(Settings):
    """Everything between the measurements and the command."""

    ego_motion: EgoMotionSettings = EgoMotionSettings()
    clusters: ClusterSettings = ClusterSettings()
    association: AssociationSettings = AssociationSettings()
    foresight: ForesightSettings = ForesightSettings()
    modes: ModeSettings = ModeSettings()
    guard: GuardSettings = GuardSettings()
    mapped_m: float = Field(0.1, gt=0, le=0.12, description="returns so near a mapped wall are it")
    mapped_sigma_m: float = Field(0.08, gt=0, le=0.1, description="while the pose is known so well")
    stale_after_s: dict[StreamName, PositiveFloat] = Field(default_factory=dict)
    under_way_s: dict[StreamName, NonNegativeFloat] = Field(
        default_factory=dict, description="so much older while the next one is seen to come"
    )


class Pipeline:
    """Holds what was last seen; `step` is the whole program."""

    def __init__(
        self,
        settings: PipelineSettings,
        controller: Controller,
        rng: np.random.Generator | None = None,
        localizer: Localizer | None = None,
        needs: Collection[str] = ("image",),
        walls: Array | None = None,
    ) -> None:
        """`rng` is that of a foresight by particles, `needs` the streams that the tracker lives by.

        A `localizer` has been started; `walls` (K, 2, 2), m, are those of its map.
        """
        self.settings = settings
        self.controller = controller
        self.localizer = localizer
        self._walls: Array = np.empty((0, 2, 2)) if walls is None else walls
        self.pose: RobotPose | None = None  # of the newest scan
        self._by_map = "pose" in needs
        self.freshness = Freshness(
            settings.stale_after_s, DRIVEN_BY.union(needs), settings.under_way_s
        )
        self.ego_motion = EgoMotion(settings.ego_motion)
        self.association = Association(settings.association)
        self.foresight = Foresight(settings.foresight, rng or np.random.default_rng(0))
        self.modes = Modes(settings.modes, self.freshness)
        self.guard = Guard(settings.guard, self.freshness)
        self._head = controller if isinstance(controller, HeadController) else None
        self._odometry: Odometry | None = None
        self._view: View | None = None
        self._track: TrackState | None = None
        self._motors = False
        self._sequence = 0

    def ego_at(self, stamp: float) -> Pose2 | None:
        """`odom_from_base` when something was measured; None when it is not known."""
        return self.ego_motion.pose_at(stamp)

    def place_at(self, stamp: float) -> Place | None:
        """Where the laser sees the followed person; None when it does not."""
        base = self.ego_at(stamp)
        return None if base is None else self.association.measured(base, stamp)

    @property
    def view(self) -> View | None:
        """The newest scan, and where it was taken."""
        return self._view

    def step(self, event: Event, now: float) -> Decision:
        """What the robot does about `event`."""
        refused = self._take(event, now)
        self._excuse_camera(now)
        permission = self.modes.permission(now)
        base, person = self.ego_at(now), self.association.person(now)
        wish = None if base is None else self._wish(permission, person, base, now)
        target = None if person is None else person.position
        seen = (self._odometry, self._view, target, self.association.claimed)
        cause, received = _cause(event), getattr(event, "received", None)
        situation = Situation(permission, base, *seen)
        command = self.guard.check(wish, situation, now, cause, received)
        self.ego_motion.commanded(command)
        # motors are not switched off under way
        self._motors = self.modes.armed or (self._motors and self.ego_motion.rolls(now))
        self._sequence += 1
        return Decision(
            self._sequence, now, self.modes.mode, self._track, wish, command,
            tuple(dict.fromkeys((*permission.reasons, *command.reasons))), self._motors, refused,
            self.pose, self._look(base, now), self.foresight.newest,
        )  # fmt: skip

    def _take(self, event: Event, now: float) -> str:
        """Remember the event; why it was refused, or nothing."""
        if isinstance(event, Scan):
            self._take_scan(event, now)
        elif isinstance(event, Odometry):
            self._odometry = event
            self.freshness.saw("odometry", event.stamp, now)
            self.ego_motion.observe(event)
            self.guard.sense(event)
            self.modes.base(event, now)
        elif isinstance(event, Tracked):
            self._take_track(event, now)
        elif isinstance(event, Fault):
            if event.device != CAMERA or "image" in self.freshness.newest:
                self.modes.fault(event, now)
        elif isinstance(event, Operator):
            refused = self.modes.operate(event.action, now, event.session)
            if event.action is Action.ENROL and not refused:
                self.association.forget()
                self.foresight.forget()
                self._track = None
            return refused
        elif isinstance(event, Presence):
            self.modes.present(event.session, now, here=event.here)
        elif isinstance(event, Late):
            self.modes.late(event.seconds, now)
        elif isinstance(event, Chassis):
            self.guard.fit(event)
        elif isinstance(event, Coming):
            self.freshness.coming(event.stream)
        elif isinstance(event, Hand):
            self.modes.drive(event.wanted, event.session, now)
        return ""

    def _take_scan(self, scan: Scan, now: float) -> None:
        self.freshness.saw("scan", scan.stamp, now)
        self._view, base = None, self.ego_at(scan.stamp)
        if base is not None:
            points = scan.points()
            clusters = find_clusters(scan, points, self.settings.clusters)
            self._localize(scan, base, now)
            located = None if self.pose is None or self.pose.lost else self.pose.map_from_odom
            mapped = self._mapped(points, clusters)
            self._view = View(scan, points, clusters, base, mapped, located)
            self.association.scan(clusters, base, points)
            if carried := self.association.carried(base, scan.stamp):
                self._judge(carried, now)
            elif self._track is not None and self.association.claimed:
                self._track = self.association.located(self._track, base, scan.stamp)

    def _localize(self, scan: Scan, base: Pose2, now: float) -> None:
        """Where the robot is on the map; once it gets lost, it may be anywhere."""
        if self.localizer is None:
            return
        person = self.association.person(scan.stamp)
        at = None if person is None else (~base).apply_point(*person.position)
        before = None if self.pose is None or self.pose.lost else self.pose
        if before is not None and scan.stamp - before.stamp > BLIND:
            self.localizer.start(before.map_from_odom @ base)
        self.pose = self.localizer.step(scan, base, at)
        if before is None or self.pose is None:
            return
        if self.pose.lost:
            self.localizer.start(None)
        moved = before.map_from_odom @ base
        jump = hypot(moved.x - self.pose.map_from_base.x, moved.y - self.pose.map_from_base.y)
        if self._by_map and jump > JUMP:
            self.modes.jumped(jump, now)

    def _mapped(self, points: Array, clusters: Clusters) -> npt.NDArray[np.bool_] | None:
        """Which clusters (K,) are the map's walls, as a board's end is; None while lost."""
        pose, s = self.pose, self.settings
        if pose is None or pose.lost or not len(self._walls):
            return None
        if float(pose.covariance.diagonal()[:2].max()) > s.mapped_sigma_m**2:
            return None
        mapped = np.zeros(len(clusters.first), np.bool_)
        near = clusters.leg_like & (clusters.nearest < s.guard.person_within_m)
        k = np.flatnonzero(near)
        walls = (~pose.map_from_base).apply(self._walls.reshape(-1, 2)).reshape(-1, 2, 2)
        mapped[k] = on_walls(points, clusters.first[k], clusters.last[k], walls, s.mapped_m)
        return mapped

    def _take_track(self, tracked: Tracked, now: float) -> None:
        if tracked.frame_id is not None:
            self.freshness.saw("image", tracked.stamp, now)
        track, base = tracked.track, self.ego_at(tracked.stamp)
        if track is not None and base is not None:
            self.association.see(track, base)
            if track.bearing is not None and track.phase in SEEN:
                self.foresight.see(track.stamp, base.theta + track.bearing)
            track = self.association.located(track, base, tracked.stamp)
            track = self.association.carried(base, tracked.stamp) or track
        self._judge(track, now)

    def _judge(self, track: TrackState | None, now: float) -> None:
        person = self.association.person(now)
        self._track = track
        self.modes.track(track, inf if person is None else person.sigma, now)

    def _excuse_camera(self, now: float) -> None:
        """A robot under way crawls on for a while by legs that are surely the person's."""
        carried = self.modes.mode is Mode.FOLLOWING and self.association.vouches(now)
        self.freshness.excuse("image", self.settings.modes.by_legs_s if carried else 0.0)

    def _wish(
        self, permission: Permission, person: Person | None, base: Pose2, now: float
    ) -> Wish | None:
        if permission.drive is not None:
            return permission.drive
        if permission.search:
            return Twist(0.0, permission.search)
        target = self._target(person, base)
        if target is None:
            return None
        return self.controller.wish(target, self._scene(base, now))

    def _look(self, base: Pose2 | None, now: float) -> LookAt | None:
        """The head too rests until the robot is armed."""
        if self._head is None or base is None or not self.modes.armed:
            return None
        return self._head.look(self._scene(base, now))

    def _scene(self, base: Pose2, now: float) -> Scene:
        twist = self.ego_motion.twist_at(now) or Twist()
        seen = self._odometry, self._view, self.association.claimed
        return Scene(now, base, twist, *seen, self.foresight.newest, self.foresight.at)

    def _target(self, person: Person | None, base: Pose2) -> Target | None:
        phase = TrackPhase.LOST if self._track is None else self._track.phase
        if person is not None:
            distance, bearing = person.seen_from(base)
            return Target(bearing, distance, person.velocity_in(base), person.sigma, phase)
        sight = self.association.bearing(base)
        return None if sight is None else Target(sight, phase=phase)


def _cause(event: Event) -> str:
    """The stream that an event comes from."""
    if isinstance(event, Tracked):
        return "scan" if event.frame_id is None else "image"
    return {Scan: "scan", Odometry: "odometry"}.get(type(event), "")
