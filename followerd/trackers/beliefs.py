"""The motion models that the tracker `stream_field` can be given, each on a map's floor."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from followerd.estimation.geodesic import Floor, Ways
from followerd.estimation.geodesic_rbpf import GeodesicRbpf
from followerd.estimation.occluded import PersonFilter
from followerd.estimation.person_filters import ConstantVelocityKalman, ConstantVelocityParticles
from followerd.estimation.stream_rbpf import StreamField, StreamFieldRbpf, StreamFieldSir
from followerd.geometry import Array
from followerd.maps.floor import FloorMap

Profile = Literal["default", "paper", "kf_cv", "sir_pf", "pf_sf"]
Builder = Callable[[np.random.Generator], PersonFilter]

OUTER = 0.3  # m from the edge of the map, walls are the room's, not boards in it


def builder(profile: Profile, floor: FloorMap) -> Builder:
    """Makes beliefs about one person on a floor; what can be computed once is computed here.

    Raises ConfigError where there is no room to walk.
    """
    match profile:
        case "default":
            ways = Ways.over(Floor.on(floor))
            return lambda rng: GeodesicRbpf(ways, rng)
        case "paper":
            boards, bounds = _room(floor.walls)
            return lambda rng: StreamFieldRbpf(StreamField(boards, bounds, rng))
        case "pf_sf":
            boards, bounds = _room(floor.walls)
            return lambda rng: StreamFieldSir(StreamField(boards, bounds, rng))
        case "sir_pf":
            return ConstantVelocityParticles
        case "kf_cv":
            return lambda _: ConstantVelocityKalman()


def _room(walls: Array) -> tuple[Array, Array]:
    """Boards (K, 2, 2) in a room, and the room's corners (2, 2), m."""
    bounds = np.array([walls.min(axis=(0, 1)), walls.max(axis=(0, 1))])
    off = np.minimum(walls - bounds[0], bounds[1] - walls)  # (K, 2, 2) from either pair of edges
    along_edge = (off < OUTER).all(axis=1).any(axis=1)
    return walls[~along_edge], bounds
