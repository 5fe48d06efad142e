"""One person by their legs in a laser's scans: a particle filter, and a memory of everybody else.

With odometry the person is tracked in `odom`, without it in `base`.
"""

from math import atan2, hypot

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.errors import UsageError
from followerd.estimation.bystanders import Bystanders, BystanderSettings
from followerd.estimation.walker import Walker, WalkerSettings
from followerd.geometry import Array, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.background import Background, BackgroundSettings
from followerd.perception.legs import LegSettings, People, find_people, speckle
from followerd.settings import Settings
from followerd.trackers.comeback import STRANGER, Comeback, ComebackSettings

Mask = npt.NDArray[np.bool_]

LONGEST_GAP = 0.5  # s between scans; after a longer one the filter is predicted no further
SURE = 0.5  # s in which confidence follows what is seen
ONE_LEG = 0.7  # of confidence that one leg alone gives


class LegsSettings(Settings):
    """One set for every scanner."""

    detector: LegSettings = LegSettings()
    walker: WalkerSettings = WalkerSettings()
    bystanders: BystanderSettings = BystanderSettings()
    background: BackgroundSettings = BackgroundSettings()
    comeback: ComebackSettings = ComebackSettings()
    enrol_m: float = Field(0.6, gt=0, description="from the point given to the nearest return")
    near_m: float = Field(2.0, gt=0, description="candidates farther from the person are others")
    own_m: float = Field(0.6, gt=0, description="around the person nothing is background")
    max_spread_m: float = Field(0.45, gt=0, description="a wider cloud has not seen the person")
    lost_after_s: float = Field(0.9, gt=0, lt=1, description="unseen this long is lost")
    speckled: float = Field(0.005, ge=0, description="share of lone returns that means sunshine")
    speckle_memory_s: float = Field(5.0, gt=0, description="over which that share is taken")
    speckle_beams: int = Field(5, ge=1, description="fewest returns of a leg in sunshine")


class Legs:
    """The tracker `legs`."""

    Settings = LegsSettings

    needs = frozenset({"scan"})
    sees: frozenset[str] = frozenset()

    def __init__(self, settings: LegsSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self._rng = rng
        self.forget()

    def forget(self) -> None:
        """Drop the enrolled person."""
        self._walker: Walker | None = None
        self._bystanders = Bystanders(self.settings.bystanders)
        self._background = Background(self.settings.background)
        self._comeback: Comeback | None = None  # while the person is lost
        self._stepped_up = False  # who is followed since: it may be anybody
        self._in_odom = False
        self._stamp = 0.0  # s
        self._last: Array = np.zeros(2)  # where the person was seen last
        self._unseen = 0.0  # s
        self._phase = TrackPhase.LOST
        self._confidence = 0.0
        self._speckle = 0.0  # share of lone returns, a running mean
        self._scans = 0

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        """Follow who stands at the point `region`, m in `base`; see Tracker. Raises UsageError."""
        if not isinstance(seen, Scan) or isinstance(region, Box):
            raise UsageError("legs follows a point x,y (m) in a laser scan, not a box in an image")
        off = seen.points() - region
        if not (np.einsum("ij,ij->i", off, off) < self.settings.enrol_m**2).any():
            x, y = region
            raise UsageError(
                f"nothing stands within {self.settings.enrol_m:g} m of ({x:g}, {y:g}) in that scan"
            )
        self.forget()
        self._in_odom = ego is not None
        at = region if ego is None else ego.apply_point(*region)
        self._walker = Walker(at, self.settings.walker, self._rng)
        self._stamp, self._last = seen.stamp, np.array(at)
        self._phase, self._confidence = TrackPhase.TENTATIVE, 0.5
        return self._state(seen, self._walker, ego)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,  # noqa: ARG002 - the laser itself knows how far
    ) -> TrackState | None:
        """The track after one more scan; None before enrolment or for a scan out of order.

        With odometry at the enrolment, a scan without says nothing new either.
        """
        walker = self._walker
        if not isinstance(measurement, Scan) or walker is None:
            return None
        if measurement.stamp <= self._stamp or (ego is None) is self._in_odom:
            return None
        if not self._in_odom:
            ego = None
        gap = measurement.stamp - self._stamp
        if self._comeback is None and gap > self.settings.lost_after_s:
            # whoever stands there now came unseen
            self._lose(self._stamp, is_crowded=bool(self._bystanders.known))
        dt = min(gap, LONGEST_GAP)
        self._stamp = measurement.stamp
        people = find_people(measurement, self.settings.detector)
        people = people.without(self._thin(measurement, people, dt))
        if ego is not None:
            people = people.without(self._still(measurement, people, ego, dt))
        position, legs = people.position, people.leg
        if ego is not None:
            position, legs = ego.apply(position), ego.apply(legs)
        if self._comeback is None:
            self._track(walker, people, position, legs, dt)
        else:
            self._look_out(walker, self._comeback, measurement, people, position, legs)
        return self._state(measurement, walker, ego)

    def _thin(self, scan: Scan, people: People, dt: float) -> Mask:
        """Which candidates (M,) are too few returns, where there are many that nothing explains."""
        s = self.settings
        self._scans += 1
        share = max(1.0 / self._scans, min(dt / s.speckle_memory_s, 1.0))
        self._speckle += share * (speckle(scan) - self._speckle)
        if self._speckle < s.speckled:
            return np.zeros(len(people.count), np.bool_)
        pair = people.legs[:, 0] != people.legs[:, 1]
        thin: Mask = people.count < np.where(pair, 2 * s.speckle_beams - 1, s.speckle_beams)
        return thin

    def _still(self, scan: Scan, people: People, ego: Pose2, dt: float) -> Mask:
        """Which candidates (M,) have stood for long where they stand."""
        points = scan.points()
        points = ego.apply(points[np.isfinite(points[:, 0])])
        self._background.learn(points, self._last, self.settings.own_m, scan.stamp, dt)
        still = self._background.stands(ego.apply(people.leg), scan.stamp)
        either: Mask = still[people.legs[:, 0]] | still[people.legs[:, 1]]
        return either

    def _track(
        self, walker: Walker, people: People, position: Array, legs: Array, dt: float
    ) -> None:
        s = self.settings
        walker.predict(dt, self._in_odom)
        expected = walker.state[:2].copy()
        trust = self._bystanders.step(legs, expected, people.stamp)[people.legs].min(axis=1)
        near = np.hypot(*(position - expected).T) < s.near_m
        walker.update(position[near], people.both[near], trust[near])
        if walker.support > 0.5 and walker.spread < s.max_spread_m:
            self._unseen, self._phase = 0.0, TrackPhase.CONFIRMED
            self._last = walker.state[:2].copy()
            self._bystanders.learn(legs, self._last)
        else:
            self._unseen += dt
            self._phase = TrackPhase.OCCLUDED
        self._judge(people, position, dt)
        if self._unseen > s.lost_after_s - 0.01:
            self._lose(people.stamp - self._unseen)

    def _lose(self, since: float, *, is_crowded: bool = False) -> None:
        """`is_crowded`: even who is near may be somebody else."""
        self._phase, self._confidence = TrackPhase.LOST, 0.0
        settings = self.settings.comeback
        if is_crowded:
            settings = settings.model_copy(update={"soon_s": 0.0})
        self._comeback = Comeback(self._last, since, settings)

    def _judge(self, people: People, position: Array, dt: float) -> None:
        """Follow confidence: full on two legs, less on one, none unseen."""
        worth = 0.0
        if self._phase is TrackPhase.CONFIRMED:
            here = np.hypot(*(position - self._last).T) < self.settings.max_spread_m
            worth = 1.0 if people.both[here].any() else ONE_LEG
        self._confidence += min(dt / SURE, 1.0) * (worth - self._confidence)

    def _look_out(
        self,
        walker: Walker,
        comeback: Comeback,
        scan: Scan,
        people: People,
        position: Array,
        legs: Array,
    ) -> None:
        trust = self._bystanders.step(legs, self._last, people.stamp)[people.legs].min(axis=1)
        in_laser = (~scan.base_from_laser).apply(people.position)
        back = comeback.step(people, position, in_laser, scan.angle_increment, trust < 1.0)
        if back is not None:
            walker.place(back)
            self._stepped_up |= comeback.is_late
            self._comeback, self._unseen, self._last = None, 0.0, back
            self._phase, self._confidence = TrackPhase.TENTATIVE, 0.5

    def _state(self, scan: Scan, walker: Walker, ego: Pose2 | None) -> TrackState:
        if self._phase is TrackPhase.LOST:
            return TrackState(scan.stamp, TrackPhase.LOST, self._confidence)
        x, y, vx, vy = walker.state.tolist()
        bx, by = (x, y) if ego is None else (~ego).apply_point(x, y)
        return TrackState(
            scan.stamp,
            self._phase,
            min(self._confidence, STRANGER) if self._stepped_up else self._confidence,
            bearing=atan2(by, bx),
            range=hypot(bx, by),
            range_sigma=walker.spread,
            position=None if ego is None else (x, y),
            velocity=(vx, vy),
            covariance=np.cov(walker.particles.T),
            particles=walker.particles[:, :2].copy(),  # they move on
        )
