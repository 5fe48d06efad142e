"""Poses tied by measured steps between them: Gauss-Newton over SE(2) (Grisetti et al. 2010).

Steps that closed a loop pull with a bounded force at first (Huber 1964); those that still
contradict the rest are then left out.
"""

from dataclasses import dataclass
from math import hypot, pi

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.sparse.linalg import spsolve

from followerd.geometry import Array, Pose2

TRUSTED = 2.0  # deviations within which a loop counts in full,
REFUTED = 5.0  # and beyond which it is wrong
LOOP_LENGTH = 1.0  # m, what a closed loop counts as
TINY = 1e-6  # m, as no edge may have no length
ITERATIONS = 20
STILL = 1e-4  # m and rad of the last step


Indices = npt.NDArray[np.intp]
Pattern = tuple[Indices, Indices, Indices, Indices]  # poses of the edges; rows, columns of entries


@dataclass(frozen=True, slots=True, eq=False)
class Edge:
    """Pose `second` seen from pose `first`."""

    first: int
    second: int
    step: Pose2  # first_from_second
    information: Array  # (3, 3) of x, y, theta in the frame of `first`
    is_loop: bool = False


class PoseGraph:
    """K poses, of which the first stays where it is."""

    def __init__(self) -> None:
        self.poses: list[Pose2] = []
        self.edges: list[Edge] = []

    def distances(self, pose: int) -> Array:
        """Length (K,) of the shortest way along the edges to each pose, m."""
        first, second = self._ends()
        lengths = [LOOP_LENGTH if e.is_loop else hypot(e.step.x, e.step.y) for e in self.edges]
        size = len(self.poses)
        ways = coo_matrix((np.array(lengths) + TINY, (first, second)), (size, size))
        lengths_to: Array = dijkstra(ways, directed=False, indices=np.array([pose]))[0]
        return lengths_to

    def optimise(self) -> None:
        """Move the poses to where the edges fit best."""
        x = np.array([(pose.x, pose.y, pose.theta) for pose in self.poses])
        first, second = self._ends()
        pattern = _pattern(first, second)
        z = np.array([(e.step.x, e.step.y, e.step.theta) for e in self.edges])
        information = np.array([edge.information for edge in self.edges])
        is_loop = np.array([edge.is_loop for edge in self.edges])
        for robustly in (True, False):
            refuted = np.zeros(len(z), bool)
            for _ in range(ITERATIONS):
                error, A, B = _linearised(x[first], x[second], z)
                off = np.sqrt(np.einsum("ei,eij,ej->e", error, information, error))
                if robustly:
                    weight = np.where(is_loop, TRUSTED / np.maximum(off, TRUSTED), 1.0)
                else:
                    refuted |= is_loop & (off > REFUTED)
                    weight = np.where(refuted, 0.0, 1.0)
                step = _step(error, A, B, weight[:, None, None] * information, pattern, len(x))
                x = x + step
                if np.abs(step).max() < STILL:
                    break
        x[:, 2] = (x[:, 2] + pi) % (2.0 * pi) - pi
        self.poses = [Pose2(*row) for row in x.tolist()]

    def _ends(self) -> tuple[Indices, Indices]:
        return (
            np.array([edge.first for edge in self.edges]),
            np.array([edge.second for edge in self.edges]),
        )


def _step(
    error: Array, A: Array, B: Array, information: Array, pattern: Pattern, count: int
) -> Array:
    """The Gauss-Newton step (K, 3); the first pose stays."""
    first, second, rows, columns = pattern
    J = np.stack([A, B], axis=1)  # (E, 2, 3, 3)
    H = np.einsum("eaki,ekl,eblj->eaibj", J, information, J, optimize=True)
    b = np.einsum("eaki,ekl,el->eai", J, information, error, optimize=True)
    matrix = coo_matrix((H.ravel(), (rows, columns)), (3 * count, 3 * count)).tocsc()
    vector = np.zeros((count, 3))
    np.add.at(vector, first, b[:, 0])
    np.add.at(vector, second, b[:, 1])
    step = np.zeros(3 * count)
    step[3:] = spsolve(matrix[3:, 3:], -vector.ravel()[3:])
    return step.reshape(-1, 3)


def _pattern(first: Indices, second: Indices) -> Pattern:
    """Where the entries (E, 2, 3, 2, 3) of all edges' blocks stand in the matrix."""
    index = 3 * np.stack([first, second], axis=1)[:, :, None] + np.arange(3)
    shape = (len(first), 2, 3, 2, 3)
    rows = np.broadcast_to(index[:, :, :, None, None], shape)
    columns = np.broadcast_to(index[:, None, None, :, :], shape)
    return first, second, rows.ravel(), columns.ravel()


def _linearised(a: Array, b: Array, z: Array) -> tuple[Array, Array, Array]:
    """Errors (E, 3) of the steps from poses `a` to `b`, and their derivatives (E, 3, 3)."""
    c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
    dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
    error = np.column_stack([c * dx + s * dy, -s * dx + c * dy, b[:, 2] - a[:, 2]]) - z
    error[:, 2] = (error[:, 2] + pi) % (2.0 * pi) - pi
    A, B = np.zeros((2, len(a), 3, 3))
    A[:, 0, 0], A[:, 0, 1], A[:, 0, 2] = -c, -s, -s * dx + c * dy
    A[:, 1, 0], A[:, 1, 1], A[:, 1, 2] = s, -c, -c * dx - s * dy
    A[:, 2, 2] = -1.0
    B[:, 0, 0], B[:, 0, 1], B[:, 1, 0], B[:, 1, 1] = c, s, -s, c
    B[:, 2, 2] = 1.0
    return error, A, B
