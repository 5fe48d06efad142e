"""The room of suite `tseng`, its boards, and the shortest ways round them.

A visibility graph, corner to corner, which no tracker knows. The paper gives no sizes: these are
ours.
"""

from dataclasses import dataclass, field
from heapq import heappop, heappush
from math import inf

import numpy as np

from followerd.geometry import Array

ROOM = (8.0, 6.0)  # m
THICKNESS = 0.06  # m, of a board
CLEARANCE = 0.40  # m that who walks keeps from boards

Board = tuple[complex, complex]  # the ends of its middle line


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Walls and boards: middle lines, and the segments that a laser sees."""

    boards: list[Board]
    segments: Array = field(init=False)  # (M, 4) x0 y0 x1 y1

    def __post_init__(self) -> None:
        width, depth = ROOM
        corners = [0j, width + 0j, width + depth * 1j, depth * 1j]
        walls = list(zip(corners, corners[1:] + corners[:1], strict=True))
        for board in self.boards:
            outline = corners_round(board, 0.5 * THICKNESS, 0.0)
            walls += list(zip(outline, outline[1:] + outline[:1], strict=True))
        flat = [(a.real, a.imag, b.real, b.imag) for a, b in walls]
        object.__setattr__(self, "segments", np.array(flat))


def corners_round(board: Board, aside: float, beyond: float) -> list[complex]:
    """The rectangle round a board, `aside` of its middle line and `beyond` its ends."""
    start, end = board
    along = (end - start) / abs(end - start)
    return [
        start - along * (beyond - 1j * aside),
        start - along * (beyond + 1j * aside),
        end + along * (beyond - 1j * aside),
        end + along * (beyond + 1j * aside),
    ]


def gap(a: Board, b: Board) -> float:
    """Distance between two segments, m; 0 where they cross."""

    def side(line: Board, z: complex) -> float:
        return ((line[1] - line[0]).conjugate() * (z - line[0])).imag

    if side(a, b[0]) * side(a, b[1]) < 0.0 and side(b, a[0]) * side(b, a[1]) < 0.0:
        return 0.0
    return min(distance(a, b[0]), distance(a, b[1]), distance(b, a[0]), distance(b, a[1]))


def distance(line: Board, z: complex) -> float:
    """Of a point from a segment, m."""
    along = line[1] - line[0]
    share = ((z - line[0]) * along.conjugate()).real / abs(along) ** 2
    return abs(z - line[0] - min(max(share, 0.0), 1.0) * along)


class Streets:
    """Shortest ways round the boards: the corners of their surroundings that see each other."""

    def __init__(self, boards: list[Board]) -> None:
        self.boards = boards
        keep = CLEARANCE + 0.5 * THICKNESS + 0.02
        corners = [z for board in boards for z in corners_round(board, keep, keep)]
        self.corners = [z for z in corners if self.is_open(z)]

    def is_open(self, z: complex) -> bool:
        """Whether a person can stand at `z`."""
        width, depth = ROOM
        inside = 0.4 < z.real < width - 0.4 and 0.4 < z.imag < depth - 0.4
        keep = CLEARANCE + 0.5 * THICKNESS
        return inside and all(distance(board, z) > keep for board in self.boards)

    def sees(self, a: complex, b: complex) -> bool:
        """Whether a person can walk straight from `a` to `b`."""
        if abs(b - a) < 1e-6:
            return True
        keep = CLEARANCE + 0.5 * THICKNESS
        return all(gap((a, b), board) > keep for board in self.boards)

    def way(self, start: complex, goal: complex) -> list[complex]:
        """Corners to pass and the goal; straight on where `start` is too near to a board."""
        nodes = [start, goal, *self.corners]
        best, before = [0.0] + [inf] * (len(nodes) - 1), [-1] * len(nodes)
        waiting = [(0.0, 0)]
        while waiting:
            length, k = heappop(waiting)
            if k == 1:
                break
            if length > best[k]:
                continue
            for j, node in enumerate(nodes):
                further = length + abs(node - nodes[k])
                if further < best[j] and self.sees(nodes[k], node):
                    best[j], before[j] = further, k
                    heappush(waiting, (further, j))
        if before[1] < 0:
            nearest = min(self.corners, key=lambda z: abs(z - start), default=goal)
            return [nearest] if abs(nearest - start) > 0.3 else [goal]
        path, k = [], 1
        while k != 0:
            path.append(nodes[k])
            k = before[k]
        return path[::-1]
