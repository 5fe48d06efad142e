"""Suite `motai`: pictures as the paper's figures 8 to 14."""

from collections.abc import Sequence
from typing import get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from followerd.bench.motai_runs import Outcome
from followerd.bench.motai_target import FRAMES, PERIOD, SIGMA, SPEEDS
from followerd.estimation.predictors import Kind

TIME = PERIOD * np.arange(1, FRAMES + 1)
THEIRS: tuple[Kind, ...] = ("kf", "of", "ofkf")  # the paper's own three
COLOURS = {kind: f"C{k}" for k, kind in enumerate(get_args(Kind))}  # the same in every picture
NUMBERS = {"A": 8, "B": 9, "C": 10}


def plots(outcomes: Sequence[Outcome]) -> dict[str, Figure]:
    """By title; what shows single runs shows the first seed."""
    first = [one for one in outcomes if one.job.seed == outcomes[0].job.seed]
    angles = {
        f"figure {number}: {target}, foreseen and true pan": _angles(first, target, get_args(Kind))
        for target, number in NUMBERS.items()
    }
    return {
        **angles,
        "figure 11: pan over the column in the image, B-fast": _over_columns(first),
        "figure 12: mean error in turns": _in_turns(outcomes),
        "figure 13: time of each step": _times(first),
        "figure 14: B, arbitration and particles": _angles(first, "B", ("ofkf", "pf", "imm_pda")),
    }


def _of(outcomes: Sequence[Outcome], target: str, speed: str) -> dict[Kind, Outcome]:
    return {o.job.kind: o for o in outcomes if (o.job.target, o.job.speed) == (target, speed)}


def _angles(outcomes: Sequence[Outcome], target: str, kinds: Sequence[Kind]) -> Figure:
    figure = Figure((9.0, 7.0), layout="constrained")
    axes: list[Axes] = list(figure.subplots(len(SPEEDS), 1, sharex=True))
    for ax, speed in zip(axes, SPEEDS, strict=True):
        runs = _of(outcomes, target, speed)
        for kind in kinds:
            ax.plot(TIME, runs[kind].foreseen, color=COLOURS[kind], linewidth=0.8, label=kind)
        true = runs[kinds[0]].true
        ax.plot(TIME, true, color="black", linewidth=1.3, label="true")
        margin = 0.2 * float(np.ptp(true)) + 2.0  # wild ones go off the picture
        ax.set(ylabel="pan, deg", title=f"{target}-{speed}")
        ax.set_ylim(float(true.min()) - margin, float(true.max()) + margin)
    axes[-1].set_xlabel("s")
    axes[-1].legend(ncols=6, fontsize="small")
    return figure


def _over_columns(outcomes: Sequence[Outcome]) -> Figure:
    """Where the pan's command comes from: the column, with the head a little behind."""
    figure = Figure((9.0, 4.0), layout="constrained")
    ax: Axes = figure.subplots()
    runs = _of(outcomes, "B", "fast")
    for kind in THEIRS:
        ax.plot(runs[kind].columns, runs[kind].foreseen, ".", markersize=4, label=kind)
    one = runs["kf"]
    ax.plot(one.columns, one.true, "k+", markersize=5, label="true")
    ax.set(xlabel="column from the middle, px", ylabel="pan, deg")
    ax.set_ylim(float(one.true.min()) - 15.0, float(one.true.max()) + 15.0)
    ax.legend(ncols=4, fontsize="small")
    return figure


def _in_turns(outcomes: Sequence[Outcome]) -> Figure:
    figure = Figure((9.0, 3.5), layout="constrained")
    axes: list[Axes] = list(figure.subplots(1, len(SIGMA), sharey=True))
    kinds: tuple[Kind, ...] = get_args(Kind)
    width = 0.8 / len(kinds)
    for ax, target in zip(axes, SIGMA, strict=True):
        for i, kind in enumerate(kinds):
            means = [_turn_error(outcomes, target, speed, kind) for speed in SPEEDS]
            places = np.arange(len(SPEEDS)) + i * width
            ax.bar(places, means, width, color=COLOURS[kind], label=kind)
        ax.set_xticks(np.arange(len(SPEEDS)) + 0.4 - 0.5 * width, list(SPEEDS))
        ax.set_title(target)
    axes[0].set_ylabel("deg")
    axes[0].legend(fontsize="small")
    return figure


def _turn_error(outcomes: Sequence[Outcome], target: str, speed: str, kind: Kind) -> float:
    errors = [
        one.errors[one.turning]
        for one in outcomes
        if (one.job.target, one.job.speed, one.job.kind) == (target, speed, kind)
    ]
    together = np.concatenate(errors)
    return float(together.mean()) if together.size else 0.0


def _times(outcomes: Sequence[Outcome]) -> Figure:
    figure = Figure((9.0, 3.5), layout="constrained")
    ax: Axes = figure.subplots()
    for kind, one in _of(outcomes, "B", "moderate").items():
        steps = np.arange(1, FRAMES + 1)
        ax.semilogy(steps, one.times, color=COLOURS[kind], linewidth=0.9, label=kind)
    ax.set(xlabel="step", ylabel="us")
    ax.legend(ncols=5, fontsize="small")
    return figure
