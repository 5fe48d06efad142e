"""A run's decisions laid beside the truth: at every instant, what was claimed and what was so."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import atan2, cos, hypot, sin

import numpy as np

from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import Decision, Mode, TrackPhase
from followerd.sim.truth import Truth

ON_PERSON = 0.5  # m; a track within this of a person stands on that person
WRONG = 1.0  # m; a track on nobody is wrong when its ray passes the target by more
BODY = 0.25  # m; one on somebody else is, but for a ray that goes through the target's body
STALE = 0.5  # s; an older track tells nothing about now
TARGET = 0  # index of the target among the people


@dataclass(frozen=True, slots=True)
class Look:
    """The truth of one instant beside the newest decision of that time."""

    truth: Truth
    mode: Mode
    drives: bool = False  # the decision asks for more than a turn
    held: bool = False  # there is a fresh track that is not lost
    person: int | None = None  # whom it stands on: TARGET, another's index, None = nobody
    miss: float | None = None  # m, of the target from the ray in which the track lies
    position_error: float | None = None  # m
    range_error: float | None = None  # m
    bearing_error: float | None = None  # rad

    @property
    def on_target(self) -> bool:
        """Whether the person's position is known and right."""
        return self.position_error is not None and self.position_error <= ON_PERSON

    @property
    def follows_wrongly(self) -> bool:
        """Whether the robot is driven after something that is not its person.

        A track in the person's direction leads to the person, however far off it takes them to be:
        the range may be that of whoever passes between.
        """
        if self.mode is not Mode.FOLLOWING or not self.drives:
            return False
        if self.miss is None or self.person == TARGET:
            return False
        return self.miss > (WRONG if self.person is None else BODY)


def looks(truths: Sequence[Truth], decisions: Sequence[Decision]) -> list[Look]:
    """Every truth beside the newest decision made until then; both in the order of time."""
    if not truths:
        return []
    stamps = [decision.stamp for decision in decisions]
    between = Between(truths)
    result = []
    for truth in truths:
        newest = bisect_right(stamps, truth.stamp) - 1
        decision = decisions[newest] if newest >= 0 else None
        result.append(_look(truth, decision, between))
    return result


class Between:
    """The truth between its instants, as seen from the robot."""

    def __init__(self, truths: Sequence[Truth]) -> None:
        self._stamps = np.array([truth.stamp for truth in truths])
        robots = np.array([(t.pose.x, t.pose.y, t.pose.theta) for t in truths])
        self._robots = np.column_stack([robots[:, :2], np.unwrap(robots[:, 2])])
        actors = [[(a.x, a.y) for a in (truth.target, *truth.others)] for truth in truths]
        self._actors = np.array(actors).reshape(len(truths), -1)

    def people(self, stamp: float) -> Array:
        """Everybody (people, 2) in `base` at `stamp`, the target first, m."""
        robot = Pose2(*self._at(self._robots, stamp))
        return (~robot).apply(np.array(self._at(self._actors, stamp)).reshape(-1, 2))

    def _at(self, values: Array, stamp: float) -> list[float]:
        return [float(np.interp(stamp, self._stamps, column)) for column in values.T]


def _look(truth: Truth, decision: Decision | None, between: Between) -> Look:
    if decision is None:
        return Look(truth, Mode.DISARMED)
    track = decision.track
    if track is None or track.phase is TrackPhase.LOST or truth.stamp - track.stamp > STALE:
        return Look(truth, decision.mode)
    drives = decision.command.speed != 0.0
    if track.bearing is None:
        return Look(truth, decision.mode, drives, held=True)
    people = between.people(track.stamp)
    x, y = people[TARGET].tolist()
    bearing_error = wrap_angle(track.bearing - atan2(y, x))
    miss = _distance_from_ray(hypot(x, y), bearing_error)
    if track.range is None:
        return Look(truth, decision.mode, drives, True, miss=miss, bearing_error=bearing_error)
    claimed = (track.range * cos(track.bearing), track.range * sin(track.bearing))
    apart = np.hypot(*(people - claimed).T)
    return Look(
        truth,
        decision.mode,
        drives,
        held=True,
        person=_person(apart),
        miss=miss,
        position_error=float(apart[TARGET]),
        range_error=track.range - hypot(x, y),
        bearing_error=bearing_error,
    )


def _person(apart: Array) -> int | None:
    """Whom a track stands on, by its distances from the people; the target where in doubt."""
    if apart[TARGET] <= ON_PERSON:
        return TARGET
    nearest = int(np.argmin(apart))
    return nearest if apart[nearest] <= ON_PERSON else None


def _distance_from_ray(distance: float, angle: float) -> float:
    """Of a point at `distance` and `angle` from a ray's start and direction, m."""
    return distance * abs(sin(angle)) if cos(angle) > 0 else distance
