"""The pictures of suite `tseng`, as figures 9 and 11 to 14 of Tseng and Tang 2009."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from followerd.bench.tseng_localization import Drive
from followerd.bench.tseng_room import ROOM, Room
from followerd.bench.tseng_world import PERIOD
from followerd.geometry import Array

Complex = npt.NDArray[np.complex128]
COLOURS = {
    "kf_cv": "tab:blue",
    "sir_pf": "tab:green",
    "pf_sf": "tab:purple",
    "stream_field/paper": "tab:red",
    "stream_field/default": "tab:orange",
    "odometer": "tab:blue",
    "line_ekf": "tab:red",
}
TABLE_1_AND_3 = ("kf_cv", "sir_pf", "stream_field/paper", "stream_field/default")


class Named(Protocol):
    """The name of a run."""

    @property
    def scenario(self) -> str:
        """Of what."""
        ...

    @property
    def seed(self) -> int:
        """And which."""
        ...


class Tracked(Protocol):
    """A run, as it is drawn."""

    @property
    def job(self) -> Named:
        """Which run."""
        ...

    @property
    def room(self) -> Room:
        """Where."""
        ...

    @property
    def truth(self) -> Complex:
        """(T,) the person."""
        ...

    @property
    def hidden(self) -> Array:
        """(T,) s."""
        ...

    @property
    def estimates(self) -> Mapping[str, Complex]:
        """(T,) by tracker."""
        ...

    @property
    def goals(self) -> Complex:
        """(T,) mean goal of the paper's filter."""
        ...


def tracking(outcomes: Sequence[Tracked]) -> dict[str, Figure]:
    """Paths and errors of the first run of `ellipse` and of `boards`."""
    first: dict[str, Tracked] = {}
    for outcome in outcomes:
        first.setdefault(outcome.job.scenario, outcome)
    ellipse, boards = first["ellipse"], first["boards"]
    return {
        f"figure 9a: paths on the ellipse, seed {ellipse.job.seed}": paths(ellipse),
        "figure 9b: errors on the ellipse": errors(ellipse),
        f"figure 12: paths among boards, seed {boards.job.seed}": paths(boards),
        "figure 13: errors among boards; grey: hidden": errors(boards),
        "figure 14: person and goal of stream_field/paper": goals(boards),
    }


def paths(run: Tracked) -> Figure:
    """The person's path, and what each tracker made of it."""
    figure, ax = _plan(run.room)
    ax.plot(run.truth.real, run.truth.imag, color="black", linewidth=1.5, label="true")
    for name in TABLE_1_AND_3:
        z = run.estimates[name]
        ax.plot(z.real, z.imag, color=COLOURS[name], linewidth=0.8, label=name)
    ax.legend(fontsize="small")
    return figure


def errors(run: Tracked) -> Figure:
    """Errors over time."""
    figure = Figure((9.0, 3.5), layout="constrained")
    ax = figure.subplots()
    time = PERIOD * np.arange(run.truth.size)
    ax.fill_between(
        time, 0, 1, where=list(run.hidden > 0.0), color="0.9", step="mid",
        transform=ax.get_xaxis_transform(),
    )  # fmt: skip
    for name in TABLE_1_AND_3:
        off = 100.0 * np.abs(run.estimates[name] - run.truth)
        ax.plot(time, off, color=COLOURS[name], linewidth=0.9, label=name)
    ax.set(xlabel="time, s", ylabel="error, cm", ylim=(0, None))
    ax.legend(fontsize="small")
    return figure


def goals(run: Tracked) -> Figure:
    """Where the person is thought to be, and to want to go."""
    figure, ax = _plan(run.room)
    z = run.estimates["stream_field/paper"]
    ax.plot(run.truth.real, run.truth.imag, color="black", linewidth=1.0, label="true")
    ax.plot(z.real, z.imag, color="tab:red", linewidth=0.9, label="person")
    ax.plot(run.goals.real, run.goals.imag, ".", color="tab:blue", markersize=3, label="goal")
    for person, goal in zip(z[::4].tolist(), run.goals[::4].tolist(), strict=True):
        ax.plot([person.real, goal.real], [person.imag, goal.imag], color="0.8", linewidth=0.6)
    ax.legend(fontsize="small")
    return figure


def robot(drive: Drive) -> Figure:
    """The robot's path, by odometry and by walls."""
    figure, ax = _plan(drive.room)
    ax.plot(drive.truth[:, 0], drive.truth[:, 1], color="black", linewidth=1.5, label="true")
    for name, poses in drive.thought.items():
        ax.plot(poses[:, 0], poses[:, 1], color=COLOURS[name], linewidth=0.9, label=name)
    ax.legend(fontsize="small")
    return figure


def _plan(room: Room) -> tuple[Figure, Axes]:
    figure = Figure((8.0, 6.2), layout="constrained")
    ax = figure.subplots()
    for ax_, ay, bx, by in room.segments.tolist():
        ax.plot([ax_, bx], [ay, by], color="0.4", linewidth=1.5)
    ax.set(aspect="equal", xlabel="x, m", ylabel="y, m", xlim=(-0.2, ROOM[0] + 0.2))
    return figure, ax
