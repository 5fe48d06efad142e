"""Figures 2 and 3 of Kwolek 2004: the motion model, and a cloud that finds its place."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from followerd.bench.kwolek_room import SIZE, Moment
from followerd.estimation.pose_cloud import MotionNoise, moved
from followerd.geometry import Array, Pose2

PAPERS = MotionNoise(along_m=0.01, drift_deg=5.0, turn_share=0.0, turn_deg=0.0, tail_share=0.0)
SHOWN = (1, 2, 8, 15)  # updates
ARROW = 0.3  # m


def motion() -> Figure:
    """Where the robot may be after 1 and 2 m, with the paper's deviations, in one step and ten."""
    figure = Figure((9.0, 3.4), layout="constrained")
    rng = np.random.default_rng(2)
    for ax, steps in zip(figure.subplots(1, 2, sharey=True), (1, 10), strict=True):
        poses: Array = np.zeros((3, 1000))
        for metre in (1, 2):
            for _ in range(steps):
                poses = moved(poses, Pose2(1.0 / steps), PAPERS, rng)
            ax.plot(*poses[:2], ".", markersize=2, label=f"after {metre} m")
        ax.plot(0.0, 0.0, "k+")
        ax.set(title=f"{steps} step{'s' if steps > 1 else ''} a metre", xlabel="m", aspect="equal")
        ax.legend(fontsize="small")
    return figure


def clouds(
    walls: Array, moments: Sequence[Moment], shown: Mapping[int, tuple[Array, Pose2]]
) -> Figure:
    """Particles (3, N), estimate and truth after some updates, counted from 1."""
    figure = Figure((9.0, 7.6), layout="constrained")
    for ax, (update, (poses, estimate)) in zip(
        figure.subplots(2, 2).ravel(), shown.items(), strict=False
    ):
        _room(ax, walls)
        ax.plot(*poses[:2], ".", color="tab:blue", markersize=2)
        _robot(ax, estimate, "tab:red", "estimate")
        _robot(ax, moments[update - 1].truth, "black", "true")
        ax.set_title(f"after update {update}")
    ax.legend(fontsize="small")
    return figure


def errors(place: Mapping[str, Array], start: int) -> Figure:
    """The median error (T,), m, of each localizer over its runs."""
    figure = Figure((9.0, 3.4), layout="constrained")
    ax = figure.subplots()
    for name, median in place.items():
        ax.semilogy(np.arange(median.size) + 1, 100.0 * np.maximum(median, 1e-3), label=name)
    if start:
        ax.axvline(start + 1, color="0.6", linestyle=":", label="carried off")
    ax.set(xlabel="update", ylabel="median error, cm")
    ax.legend(fontsize="small")
    return figure


def _room(ax: Axes, walls: Array) -> None:
    for wall in walls:
        ax.plot(*wall.T, color="0.4", linewidth=1.0)
    ax.set(aspect="equal", xlim=(-0.1, SIZE[0] + 0.1), ylim=(-0.1, SIZE[1] + 0.1))


def _robot(ax: Axes, pose: Pose2, colour: str, label: str) -> None:
    tip = pose.apply_point(ARROW, 0.0)
    ax.plot([pose.x, tip[0]], [pose.y, tip[1]], color=colour, linewidth=2.0)
    ax.plot(pose.x, pose.y, "o", color=colour, label=label)
