"""From a scan to the candidates that every tracker of suite `tseng` is given."""

from followerd.estimation.occluded import Sweep
from followerd.geometry import Array, Pose2
from followerd.messages import Scan
from followerd.perception.foreground import ForegroundSettings, foreground
from followerd.perception.legs import LegSettings, find_people
from followerd.trackers.sweeps import sweep_of


def sighted(
    scan: Scan, map_from_base: Pose2, sigmas: tuple[float, float], segments: Array
) -> Sweep:
    """The candidates in a map of `segments` (M, 4); `sigmas` of the pose, m and rad."""
    shown = foreground(scan, segments.reshape(-1, 2, 2), map_from_base, ForegroundSettings())
    return sweep_of(scan, find_people(scan, LegSettings(), shown), map_from_base, sigmas)
