"""One person by their legs on a known map, also while furniture hides them.

Tseng and Tang 2009: candidates are beams that the map does not explain (`perception.foreground`,
`perception.legs`), the person is followed by a Rao-Blackwellised particle filter whose motion
goes round obstacles (`profile: paper`, the stream field; `default`, shortest ways to many goals;
baselines `kf_cv`, `sir_pf`, `pf_sf`). It thinks in `map` and speaks in `odom`.
"""

from math import atan2, exp, hypot

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.errors import UsageError
from followerd.estimation.bystanders import Bystanders, BystanderSettings
from followerd.estimation.occluded import Estimate, Pursuit, PursuitSettings
from followerd.estimation.person_filters import ConstantVelocityKalman
from followerd.geometry import Array, Pose2
from followerd.maps.floor import FloorMap
from followerd.messages import (
    Box,
    Image,
    Odometry,
    Place,
    RobotPose,
    Scan,
    TrackPhase,
    TrackState,
)
from followerd.perception.background import Background, BackgroundSettings
from followerd.perception.foreground import ForegroundSettings, foreground
from followerd.perception.legs import LegSettings, People, find_people
from followerd.settings import Settings
from followerd.trackers.beliefs import Builder, Profile, builder
from followerd.trackers.comeback import STRANGER, Comeback, ComebackSettings
from followerd.trackers.sweeps import sweep_of

Mask = npt.NDArray[np.bool_]

LONGEST_GAP = 0.5  # s between scans, over which background is learned
TRUSTED = 0.5  # of a leg: below, it is known to be somebody else's
FASTEST = 1.5  # m/s, of the person
COURSES = 5  # of the person, that are drawn


class StreamFieldTrackerSettings(Settings):
    """What is seen, how it is followed, and for how long."""

    profile: Profile = Field("default", description="motion model: as the paper's, or ours")
    detector: LegSettings = LegSettings()
    foreground: ForegroundSettings = ForegroundSettings()
    pursuit: PursuitSettings = PursuitSettings(reacquire_s=0.3)
    bystanders: BystanderSettings = BystanderSettings()
    background: BackgroundSettings = BackgroundSettings()
    comeback: ComebackSettings = ComebackSettings(soon_s=0.0)
    enrol_m: float = Field(0.6, gt=0, description="from the point given to the nearest return")
    own_m: float = Field(0.6, gt=0, description="around the person nothing is background")
    period_s: float = Field(0.09, ge=0, description="not to be seen sooner again tells nothing new")
    reach_m: float = Field(1.0, gt=0, description="from where they were seen last, they may be")
    reach_mps: float = Field(1.5, gt=0, description="by which that grows")
    blink_s: float = Field(0.15, ge=0, description="unseen so shortly is not hidden")
    lost_after_s: float = Field(8.0, gt=0, description="unseen this long is lost")
    blind_s: float = Field(0.9, gt=0, lt=1, description="without scan or odometry, too")
    confidence_s: float = Field(6.0, gt=0, description="in which confidence fades unseen")
    velocity_s: float = Field(0.5, gt=0, description="over which the velocity is taken")
    jump_m: float = Field(0.5, gt=0, description="of the robot on the map: the person is unsure")
    unsure_s: float = Field(0.5, ge=0, description="after such a jump")
    off_map_s: float = Field(1.0, gt=0, le=1, description="without a pose the map does not count")


class StreamFieldTracker:
    """The tracker `stream_field`; implements MapTracker."""

    Settings = StreamFieldTrackerSettings

    needs = frozenset({"scan", "pose"})
    sees: frozenset[str] = frozenset()

    def __init__(self, settings: StreamFieldTrackerSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self._walls: Array = np.empty((0, 2, 2))
        self._belief: Builder | None = None
        self._map_from_odom: Pose2 | None = None
        self._sigmas = (0.0, 0.0)  # m and rad, of the robot's pose
        self._located_at = 0.0  # s
        self.forget()

    def enter(self, floor: FloorMap) -> None:
        """See MapTracker."""
        self._walls = floor.walls
        self._belief = builder(self.settings.profile, floor)

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._pursuit: Pursuit | None = None
        self._on_map = True  # the belief goes round the map's obstacles
        self._bystanders = Bystanders(self.settings.bystanders)
        self._background = Background(self.settings.background)
        self._comeback: Comeback | None = None  # while the person is lost
        self._stepped_up = False  # who is followed since: it may be anybody
        self._stamp = 0.0  # s
        self._last = 0j  # where the person was seen last, in `map`
        self._velocity = 0j  # m/s, in `map`
        self._before: Estimate | None = None
        self._unsure_until = 0.0  # s

    def locate(self, pose: RobotPose | None, ego: Pose2 | None) -> None:
        """See MapTracker; between poses the robot is where its odometry says."""
        if pose is None or pose.lost:
            return
        old, self._map_from_odom = self._map_from_odom, pose.map_from_odom
        x, y, theta = np.sqrt(np.maximum(pose.covariance.diagonal(), 0.0)).tolist()
        self._sigmas = max(x, y), theta
        self._located_at = pose.stamp
        if old is not None and ego is not None:
            before, now = old @ ego, pose.map_from_base
            if hypot(now.x - before.x, now.y - before.y) > self.settings.jump_m:
                self._carry_over(pose.map_from_odom @ ~old, pose.stamp)

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Follow who stands at the point `region`, m in `base`; see Tracker. Raises UsageError."""
        if not isinstance(seen, Scan) or isinstance(region, Box):
            raise UsageError(
                "stream_field follows a point x,y (m) in a scan, not a box in an image"
            )
        if self._belief is None:
            raise UsageError("stream_field needs a map: followerd run with a localizer section")
        if ego is None or self._map_from_odom is None:
            raise UsageError("the robot does not know yet where it is on the map")
        off = seen.points() - region
        if not (np.einsum("ij,ij->i", off, off) < self.settings.enrol_m**2).any():
            x, y = region
            raise UsageError(
                f"nothing stands within {self.settings.enrol_m:g} m of ({x:g}, {y:g}) in that scan"
            )
        self.forget()
        at = complex(*(self._map_from_odom @ ego).apply_point(*region))
        self._pursuit = Pursuit(self._belief(self._rng), self.settings.pursuit)
        self._pursuit.start(at, seen.stamp)
        self._stamp, self._last = seen.stamp, at
        estimate = Estimate(seen.stamp, at, 0.01 * np.eye(2), True, 0.0)
        return self._state(estimate, TrackPhase.TENTATIVE, ego, self._map_from_odom)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,  # noqa: ARG002 - the laser itself knows how far
    ) -> TrackState | None:
        """The track after one more scan; None before enrolment, or when it says nothing new."""
        pursuit, map_from_odom = self._pursuit, self._map_from_odom
        if not isinstance(measurement, Scan) or pursuit is None:
            return None
        dt = measurement.stamp - self._stamp
        is_seen = self._before is None or self._before.seen
        if ego is None or map_from_odom is None or dt <= 0.0:
            return None
        if dt < self.settings.period_s and not is_seen:
            return None
        if self._comeback is None and dt > self.settings.blind_s:
            self._lose(self._stamp)  # whoever stands there now came unseen
        self._stamp = measurement.stamp
        self._choose_belief(pursuit)
        here = map_from_odom @ ego
        people = self._people(measurement, here, ego, min(dt, LONGEST_GAP))
        if self._comeback is not None:
            self._look_out(pursuit, self._comeback, measurement, people, here)
            if self._comeback is not None:
                return TrackState(measurement.stamp, TrackPhase.LOST, 0.0)
        kept = people.without(self._out_of_reach(people, here))
        estimate = pursuit.step(sweep_of(measurement, kept, here, self._sigmas))
        assert estimate is not None  # a pursuit that was started always has one
        self._note(estimate, people, here, dt)
        if estimate.unseen_for > self.settings.lost_after_s:
            self._lose(measurement.stamp - estimate.unseen_for)
        return self._state(estimate, self._phase(estimate), ego, map_from_odom)

    def _lose(self, since: float) -> None:
        last = np.array([self._last.real, self._last.imag])
        self._comeback = Comeback(last, since, self.settings.comeback)

    def courses(self) -> Array:
        """See Foreseeing."""
        courses = getattr(self._pursuit and self._pursuit.belief, "courses", None)
        if courses is None or self._map_from_odom is None or self._comeback is not None:
            return np.empty((0, 0, 2))
        z = courses(COURSES)
        points = (~self._map_from_odom).apply(np.column_stack([z.real.ravel(), z.imag.ravel()]))
        return points.reshape(*z.shape, 2)

    def _choose_belief(self, pursuit: Pursuit) -> None:
        """A robot that is lost knows no ways round obstacles (FAILSAFES F17)."""
        on_map = self._stamp - self._located_at <= self.settings.off_map_s
        if on_map is self._on_map or self._belief is None:
            return
        self._on_map, at = on_map, pursuit.belief.position()
        pursuit.belief = self._belief(self._rng) if on_map else ConstantVelocityKalman()
        pursuit.belief.start(at)

    def _carry_over(self, shift: Pose2, stamp: float) -> None:
        """The map has moved under the robot by `shift`: the person is where they were in `odom`."""
        if self._pursuit is None:
            return
        at = self._pursuit.belief.position()
        self._pursuit.belief.start(complex(*shift.apply_point(at.real, at.imag)))
        self._last = complex(*shift.apply_point(self._last.real, self._last.imag))
        self._velocity, self._before = 0j, None
        self._unsure_until = stamp + self.settings.unsure_s

    def _people(self, scan: Scan, here: Pose2, ego: Pose2, dt: float) -> People:
        """Candidates that neither the map nor what has stood for long explains."""
        walls = self._walls if self._on_map else self._walls[:0]
        shown = foreground(scan, walls, here, self.settings.foreground)
        people = find_people(scan, self.settings.detector, shown)
        assert self._map_from_odom is not None
        last = (~self._map_from_odom).apply_point(self._last.real, self._last.imag)
        points = scan.points()
        points = ego.apply(points[np.isfinite(points[:, 0])])
        self._background.learn(points, np.array(last), self.settings.own_m, scan.stamp, dt)
        still = self._background.stands(ego.apply(people.leg), scan.stamp)
        return people.without(still[people.legs[:, 0]] | still[people.legs[:, 1]])

    def _out_of_reach(self, people: People, here: Pose2) -> Mask:
        """Which candidates (M,) are somebody else, or farther than the person can have walked."""
        s = self.settings
        assert self._pursuit is not None
        now = self._pursuit.belief.position()
        expected, last = (
            np.array([now.real, now.imag]),
            np.array([self._last.real, self._last.imag]),
        )
        trust = self._bystanders.step(here.apply(people.leg), expected, people.stamp)
        others = trust[people.legs].min(axis=1) < TRUSTED
        unseen = 0.0 if self._before is None else self._before.unseen_for
        away = np.hypot(*(here.apply(people.position) - last).T)
        far: Mask = others | (away > s.reach_m + s.reach_mps * unseen)
        return far

    def _note(self, estimate: Estimate, people: People, here: Pose2, dt: float) -> None:
        """Remember where the person is, how fast, and who else is there."""
        before, self._before = self._before, estimate
        if before is not None:
            speed = (estimate.position - before.position) / dt
            speed *= min(1.0, FASTEST / max(abs(speed), 1e-9))
            share = 1.0 - exp(-dt / self.settings.velocity_s)
            self._velocity += share * (speed - self._velocity)
        if estimate.seen:
            self._last = estimate.position
            person = np.array([self._last.real, self._last.imag])
            self._bystanders.learn(here.apply(people.leg), person)

    def _look_out(
        self, pursuit: Pursuit, comeback: Comeback, scan: Scan, people: People, here: Pose2
    ) -> None:
        last = np.array([self._last.real, self._last.imag])
        trust = self._bystanders.step(here.apply(people.leg), last, people.stamp)
        known = trust[people.legs].min(axis=1) < TRUSTED
        in_laser = (~scan.base_from_laser).apply(people.position)
        at = here.apply(people.position)
        back = comeback.step(people, at, in_laser, scan.angle_increment, known)
        if back is not None:
            self._last = complex(*back.tolist())
            pursuit.start(self._last, scan.stamp)
            self._stepped_up |= comeback.is_late
            self._comeback, self._before, self._velocity = None, None, 0j
            self._unsure_until = scan.stamp + self.settings.unsure_s

    def _phase(self, estimate: Estimate) -> TrackPhase:
        if estimate.unseen_for > self.settings.lost_after_s:
            return TrackPhase.LOST
        if estimate.stamp < self._unsure_until:
            return TrackPhase.TENTATIVE
        is_seen = estimate.unseen_for <= self.settings.blink_s
        return TrackPhase.CONFIRMED if is_seen else TrackPhase.OCCLUDED

    def _state(
        self, estimate: Estimate, phase: TrackPhase, ego: Pose2, map_from_odom: Pose2
    ) -> TrackState:
        if phase is TrackPhase.LOST:
            return TrackState(estimate.stamp, phase, 0.0)
        odom_from_map = ~map_from_odom
        turn = Pose2(theta=odom_from_map.theta)  # R P R' is the rows turned, and the columns
        x, y = odom_from_map.apply_point(estimate.position.real, estimate.position.imag)
        bx, by = (~ego).apply_point(x, y)
        cloud = getattr(self._pursuit and self._pursuit.belief, "cloud", None)
        drawn = None if cloud is None else np.column_stack([cloud.z.real, cloud.z.imag])
        sure = exp(-estimate.unseen_for / self.settings.confidence_s)
        return TrackState(
            estimate.stamp,
            phase,
            min(sure, STRANGER) if self._stepped_up else sure,
            bearing=atan2(by, bx),
            range=hypot(bx, by),
            range_sigma=estimate.spread,
            position=(x, y),
            velocity=turn.apply_point(self._velocity.real, self._velocity.imag),
            covariance=turn.apply(turn.apply(estimate.covariance).T),
            particles=None if drawn is None else odom_from_map.apply(drawn),
        )
