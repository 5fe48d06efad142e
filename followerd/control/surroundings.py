"""What stands around the robot: the newest scan, and what earlier ones saw beside or behind it."""

import numpy as np
import numpy.typing as npt

from followerd.control.interfaces import View
from followerd.geometry import Array, Pose2

Mask = npt.NDArray[np.bool_]

VOXEL = 0.05  # m, returns nearer to each other than this count once
THROUGH = 0.15  # m, a beam that reaches this much beyond a return shows that it has gone
LEG = 0.35  # m, widest that legs look
STRIDE = 0.7  # m, farthest that a leg is from where the person is expected
COLUMNS = 1 << 20  # voxels in a row, for numbering them


class Surroundings:
    """Returns in `odom`; those of the followed person are left out."""

    def __init__(self, reach: float, memory: float) -> None:
        """Nothing farther than `reach` m and nothing unseen for `memory` s is kept."""
        self.reach = reach
        self.memory = memory
        self.points: Array = np.empty((0, 2))  # m, in `odom`, the newest first
        self._seen: Array = np.empty(0)  # s, when each was seen last

    def carry(self, shift: Pose2) -> None:
        """`odom` has drifted: what is kept is to be found at `shift` of where it was."""
        self.points = shift.apply(self.points)

    def see(
        self, view: View, claimed: tuple[slice, ...], person: tuple[float, float] | None
    ) -> None:
        """Take a scan: what it sees through has gone, what it does not look at stays a while.

        The followed person, expected at `person` in `odom`, is left out: the `claimed` beams, and
        what may be a leg that just goes out of sight.
        """
        scan = view.scan
        shown = np.isfinite(view.points[:, 0])
        for beams in claimed:
            shown[beams] = False
        if person is not None:
            shown &= ~_legs_near(view, (~view.base).apply_point(*person))
        shown &= np.einsum("ij,ij->i", view.points, view.points) < self.reach**2
        fresh = view.base.apply(view.points[shown])
        old = (scan.stamp - self._seen <= self.memory) & ~self._seen_through(view)
        points = np.concatenate([fresh, self.points[old]])
        seen = np.concatenate([np.full(len(fresh), scan.stamp), self._seen[old]])
        voxels = np.floor(points / VOXEL).astype(np.int64)
        _, first = np.unique(voxels[:, 0] * COLUMNS + voxels[:, 1], return_index=True)
        first.sort()
        self.points, self._seen = points[first], seen[first]

    def within(self, reach: float, base: Pose2) -> Array:
        """Those (N, 2) nearer than `reach` m to a robot at `odom_from_base`."""
        off = self.points - (base.x, base.y)
        near: Array = self.points[np.einsum("ij,ij->i", off, off) < reach * reach]
        return near

    def _seen_through(self, view: View) -> Mask:
        """Which of the kept returns (N,) lie in the field of view and no longer stop a beam."""
        scan = view.scan
        if not self._seen.size or not scan.ranges.size:
            return np.zeros(self._seen.size, np.bool_)
        x, y = (~(view.base @ scan.base_from_laser)).apply(self.points).T
        beam = np.rint((np.arctan2(y, x) - scan.angle_min) / scan.angle_increment)
        beam = beam.astype(np.intp)
        looked = (beam >= 0) & (beam < scan.ranges.size)
        # the shortest of three beams; what was not measured shows nothing
        ranges = np.concatenate([[np.inf], scan.ranges, [np.inf]])
        ranges[np.isnan(ranges)] = 0.0
        shortest = np.minimum(np.minimum(ranges[:-2], ranges[1:-1]), ranges[2:])
        beam = np.where(looked, beam, 0)
        gone: Mask = looked & (shortest[beam] > np.hypot(x, y) + THROUGH)
        return gone


def _legs_near(view: View, person: tuple[float, float]) -> Mask:
    """Which beams (N,) of the view show what may be the person's legs; `person` in its `base`."""
    seen = view.clusters
    near = (seen.width < LEG) & (np.hypot(*(seen.centre - person).T) < STRIDE)
    theirs = np.zeros(len(view.points), np.bool_)
    for first, last in zip(seen.first[near].tolist(), seen.last[near].tolist(), strict=True):
        theirs[first : last + 1] = True
    return theirs
