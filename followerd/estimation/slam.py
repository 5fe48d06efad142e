"""The way a robot went, by its odometry and scans alone: matching, loop closing, a pose graph.

Each scan is matched to the surfaces of the last key scans. A key scan that may lie where the robot
was before is matched to what was seen there; a match that is good, and better than all others
around, closes a loop.
"""

from dataclasses import dataclass
from math import hypot, radians

import numpy as np

from followerd.estimation.pose_graph import Edge, PoseGraph
from followerd.estimation.scan_match import Field, Shape, Window
from followerd.geometry import Array, Pose2
from followerd.messages import Scan

KEY_STEP, KEY_TURN = 0.4, radians(20.0)  # between key scans
RECENT = 10  # key scans that the next scan is matched to
AROUND = 5  # key scans before and after one that make the place it was taken at
LOOP_WAY = 8.0  # m driven before a place counts as left
LOOP_REACH, LOOP_TURN = 0.6, radians(6.0)  # how far off a loop may be at first,
DRIFT, TURN_DRIFT = 0.03, radians(0.25)  # and for each m along the graph,
MOST_REACH, MOST_TURN = 6.0, radians(35.0)  # but no more than this
LOOP_PAUSE = 3.0  # m along the graph within which no loop is looked for
LOOP_SCORE, LEAD = 0.65, 0.05  # of a match that may close a loop
FIELD_ERROR = np.diag([0.03**2, 0.03**2, radians(0.5) ** 2])
AGREE, AGREE_TURN = 0.4, radians(5.0)  # of two loops that tell the same


@dataclass(frozen=True, slots=True, eq=False)
class Seat:
    """A scan that hangs on a key scan."""

    key: int
    step: Pose2  # key_from_scan


class Mapper:
    """Takes scans in order; `poses` are those of all, improved by every loop closed."""

    def __init__(self) -> None:
        self.graph = PoseGraph()
        self.loops: list[Edge] = []
        self._shapes: list[Shape] = []  # of key scans
        self._way: list[float] = []  # m driven up to each key scan
        self._seats: list[Seat] = []
        self._ego = Pose2()
        self._recent: tuple[Field, int] | None = None  # and the key scan it is around
        self._waiting: list[Edge] = []  # loops that nothing agrees with yet

    @property
    def poses(self) -> list[Pose2]:
        """`map_from_base` of every scan so far; the first is where its odometry says."""
        return [self.graph.poses[seat.key] @ seat.step for seat in self._seats]

    def add(self, scan: Scan, ego: Pose2) -> None:
        """Take one more scan, at `ego` (`odom_from_base`)."""
        origin = (scan.base_from_laser.x, scan.base_from_laser.y)
        shape = Shape.of(scan.points(), origin)
        if not self._seats:
            self._become_key(shape, ego, 0.0)
            self._ego = ego
            return
        moved, self._ego = ~self._ego @ ego, ego
        last = self._seats[-1]
        expected = last.step @ moved  # in the frame of the last key scan
        window = _window(moved)
        found = self._recent_field().match(shape.points, expected, window)
        step = found.pose if found is not None else expected
        if hypot(step.x, step.y) < KEY_STEP and abs(step.theta) < KEY_TURN:
            self._seats.append(Seat(last.key, step))
            return
        information = window.information
        if found is not None:
            information = _softened(found.information + information)
        key = len(self.graph.poses)
        self.graph.edges.append(Edge(key - 1, key, step, information))
        self._become_key(shape, self.graph.poses[-1] @ step, hypot(step.x, step.y))
        self._close_loop(key)

    def _become_key(self, shape: Shape, pose: Pose2, driven: float) -> None:
        self._seats.append(Seat(len(self.graph.poses), Pose2()))
        self.graph.poses.append(pose)
        self._shapes.append(shape)
        self._way.append(self._way[-1] + driven if self._way else 0.0)

    def _recent_field(self) -> Field:
        """What the last key scans saw, in the frame of the last of them."""
        key = len(self.graph.poses) - 1
        if self._recent is None or self._recent[1] != key:
            self._recent = self._field(key, range(max(0, key - RECENT + 1), key + 1)), key
        return self._recent[0]

    def _field(self, key: int, keys: range) -> Field:
        """The surfaces of some key scans, in the frame of `key`."""
        key_from_map = ~self.graph.poses[key]
        chords = [
            (key_from_map @ self.graph.poses[k]).apply(self._shapes[k].chords.reshape(-1, 2))
            for k in keys
        ]
        return Field(np.concatenate(chords).reshape(-1, 2, 2))

    def _close_loop(self, key: int) -> None:
        """Look for key scans taken where the robot is now, long before.

        A loop counts once another, a little before, agrees with it.
        """
        apart = self.graph.distances(key)
        agreed: list[Edge] = []
        for other in self._places(key, apart):
            loop = self._loop(other, key, float(apart[other]))
            if loop is None:
                continue
            partners = [p for p in self._waiting if self._agree(p, loop)]
            confirmed = [p for p in self.loops[-10:] if self._agree(p, loop)]
            if partners or confirmed:
                agreed += [*partners, loop]
                self._waiting = [p for p in self._waiting if p not in partners]
            else:
                self._waiting.append(loop)
        if agreed:
            self.loops += agreed
            self.graph.edges += agreed
            self.graph.optimise()
            self._recent = None

    def _agree(self, one: Edge, other: Edge) -> bool:
        """Whether two loops tell the same of the way between their ends."""
        way = self._way
        if abs(way[one.second] - way[other.second]) > 5.0:
            return False
        if abs(way[one.first] - way[other.first]) > 10.0:
            return False
        poses = self.graph.poses
        here = ~poses[one.second] @ poses[other.second]
        there = ~poses[one.first] @ poses[other.first]
        off = ~(there @ other.step) @ (one.step @ here)
        return hypot(off.x, off.y) < AGREE and abs(off.theta) < AGREE_TURN

    def _places(self, key: int, apart: Array) -> list[int]:
        """Key scans of long ago that may be near, the nearest first, each some way apart."""
        poses = np.array([(pose.x, pose.y) for pose in self.graph.poses])
        away = np.hypot(*(poses - poses[key]).T)
        since = self._way[key] - np.array(self._way)
        near = (since > LOOP_WAY) & (away < _reach(apart)) & (apart > LOOP_PAUSE)
        places: list[int] = []
        for k in np.flatnonzero(near)[np.argsort(away[near])].tolist():
            if all(abs(k - place) > 3 * AROUND for place in places):
                places.append(k)
            if len(places) == 2:
                break
        return places

    def _loop(self, other: int, key: int, apart: float) -> Edge | None:
        """The step from key scan `other` to `key`, where what was seen at both agrees."""
        reach, turn = float(_reach(apart)), min(LOOP_TURN + TURN_DRIFT * apart, MOST_TURN)
        expected = ~self.graph.poses[other] @ self.graph.poses[key]
        last = min(other + AROUND + 1, key - RECENT)
        field = self._field(other, range(max(0, other - AROUND), last))
        window = Window(reach, turn, reach / 3.0, turn / 2.0)
        found = field.match(self._points(key), expected, window)
        if found is None or found.score < LOOP_SCORE or found.lead < LEAD:
            return None
        return Edge(other, key, found.pose, _softened(found.information), is_loop=True)

    def _points(self, key: int) -> Array:
        """What the last key scans saw, in the frame of `key`."""
        key_from_map = ~self.graph.poses[key]
        points = [
            (key_from_map @ self.graph.poses[k]).apply(self._shapes[k].points)
            for k in range(max(0, key - AROUND + 1), key + 1)
        ]
        return np.concatenate(points)


def _reach(apart: float | Array) -> Array:
    """How far off, m, two poses so far apart along the graph may be."""
    return np.minimum(LOOP_REACH + DRIFT * np.asarray(apart), MOST_REACH)


def _softened(information: Array) -> Array:
    """The information of a match, of which the field's errors leave no more than that."""
    tiny = 1e-6 * np.eye(3)
    return np.asarray(np.linalg.inv(np.linalg.inv(information + tiny) + FIELD_ERROR))


def _window(moved: Pose2) -> Window:
    """How far the odometry of a step may be off."""
    way, turn = hypot(moved.x, moved.y), abs(moved.theta)
    return Window(
        0.3 + 0.3 * way, radians(6.0) + 0.3 * turn, 0.03 + 0.06 * way, radians(1.5) + 0.1 * turn
    )
