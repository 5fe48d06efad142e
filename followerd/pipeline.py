"""One event in, one decision out: pure, so robot, simulation and replay run the same."""

from dataclasses import dataclass
from math import inf

from pydantic import Field, PositiveFloat

from followerd.control.freshness import Freshness, StreamName
from followerd.control.guard import Guard, Situation
from followerd.control.interfaces import Controller, Scene, Target, View
from followerd.control.limits import GuardSettings
from followerd.control.mode import Action, Modes, ModeSettings, Permission
from followerd.estimation.ego_motion import EgoMotion, EgoMotionSettings
from followerd.estimation.ranging import Person, Ranging, RangingSettings
from followerd.geometry import Pose2
from followerd.messages import (
    Decision,
    Fault,
    Odometry,
    Place,
    Scan,
    TrackPhase,
    TrackState,
    Twist,
    Wish,
)
from followerd.perception.clusters import ClusterSettings, find_clusters
from followerd.settings import Settings


@dataclass(frozen=True, slots=True)
class Tracked:
    """The tracker has finished an image."""

    stamp: float  # s, of the image
    received: float  # s, of the image
    frame_id: int
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
class Tick:
    """Time has passed."""


Event = Scan | Odometry | Tracked | Operator | Presence | Hand | Late | Fault | Tick
CAUSES = {Scan: "scan", Odometry: "odometry", Tracked: "image"}


class PipelineSettings(Settings):
    """Everything between the measurements and the command."""

    ego_motion: EgoMotionSettings = EgoMotionSettings()
    clusters: ClusterSettings = ClusterSettings()
    ranging: RangingSettings = RangingSettings()
    modes: ModeSettings = ModeSettings()
    guard: GuardSettings = GuardSettings()
    stale_after_s: dict[StreamName, PositiveFloat] = Field(default_factory=dict)


class Pipeline:
    """Holds what was last seen; `step` is the whole program."""

    def __init__(self, settings: PipelineSettings, controller: Controller) -> None:
        self.settings = settings
        self.controller = controller
        self.freshness = Freshness(settings.stale_after_s)
        self.ego_motion = EgoMotion(settings.ego_motion)
        self.ranging = Ranging(settings.ranging)
        self.modes = Modes(settings.modes, self.freshness)
        self.guard = Guard(settings.guard, self.freshness)
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
        return None if base is None else self.ranging.measured(base, stamp)

    def step(self, event: Event, now: float) -> Decision:
        """What the robot does about `event`."""
        refused = self._take(event, now)
        permission = self.modes.permission(now)
        base, person = self.ego_at(now), self.ranging.person(now)
        wish = None if base is None else self._wish(permission, person, base, now)
        target = None if person is None else person.position
        seen = (self._odometry, self._view, target, self.ranging.claimed)
        cause, received = CAUSES.get(type(event), ""), getattr(event, "received", None)
        situation = Situation(permission, base, *seen)
        command = self.guard.check(wish, situation, now, cause, received)
        self.ego_motion.commanded(command)
        # motors are not switched off under way
        self._motors = self.modes.armed or (self._motors and self.ego_motion.rolls(now))
        self._sequence += 1
        return Decision(
            self._sequence, now, self.modes.mode, self._track, wish, command,
            tuple(dict.fromkeys((*permission.reasons, *command.reasons))), self._motors, refused,
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
            self.modes.fault(event, now)
        elif isinstance(event, Operator):
            refused = self.modes.operate(event.action, now, event.session)
            if event.action is Action.ENROL and not refused:
                self.ranging.forget()
                self._track = None
            return refused
        elif isinstance(event, Presence):
            self.modes.present(event.session, now, here=event.here)
        elif isinstance(event, Late):
            self.modes.late(event.seconds, now)
        elif isinstance(event, Hand):
            self.modes.drive(event.wanted, event.session, now)
        return ""

    def _take_scan(self, scan: Scan, now: float) -> None:
        self.freshness.saw("scan", scan.stamp, now)
        self._view, base = None, self.ego_at(scan.stamp)
        if base is not None:
            points = scan.points()
            clusters = find_clusters(scan, points, self.settings.clusters)
            self._view = View(scan, points, clusters, base)
            self.ranging.scan(clusters, base)
            if self._track is not None and self.ranging.claimed:
                self._track = self.ranging.located(self._track, base, scan.stamp)

    def _take_track(self, tracked: Tracked, now: float) -> None:
        self.freshness.saw("image", tracked.stamp, now)
        track, base = tracked.track, self.ego_at(tracked.stamp)
        if track is not None and base is not None:
            self.ranging.see(track, base)
            track = self.ranging.located(track, base, tracked.stamp)
        person = self.ranging.person(now)
        self._track = track
        self.modes.track(track, inf if person is None else person.sigma, now)

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
        twist = self.ego_motion.twist_at(now) or Twist()
        seen = self._odometry, self._view, self.ranging.claimed
        return self.controller.wish(target, Scene(now, base, twist, *seen))

    def _target(self, person: Person | None, base: Pose2) -> Target | None:
        phase = TrackPhase.LOST if self._track is None else self._track.phase
        if person is not None:
            distance, bearing = person.seen_from(base)
            return Target(bearing, distance, person.velocity_in(base), person.sigma, phase)
        sight = self.ranging.bearing(base)
        return None if sight is None else Target(sight, phase=phase)
