"""A picture of a fuzzy follow law: its sets, and speed and gain over their inputs."""

import numpy as np
from matplotlib.figure import Figure, FigureBase

from followerd.control.fuzzy import SETS, Surface, load, memberships
from followerd.control.fuzzy_gears import FuzzyGearsSettings

FINE = 101  # points each way


def picture(settings: FuzzyGearsSettings) -> Figure:
    """Input sets, the speed over what is ahead, the gain over what is aside."""
    figure = Figure((12.0, 4.0), layout="constrained")
    draw(figure, settings)
    return figure


def draw(figure: FigureBase, settings: FuzzyGearsSettings) -> None:
    """The same into a part of a figure."""
    rules = load(settings.rules or settings.profile)
    sets, speed, gear = figure.subplots(1, 3)
    half = np.linspace(-1.0, 1.0, FINE)
    for name, grades in zip(SETS, memberships(half, rules.sigma), strict=True):
        sets.plot(half, grades, label=name)
    sets.set(
        xlabel="input, half domains", ylabel="membership", title=rules.inference, ylim=(0.0, 1.25)
    )
    sets.legend(loc="upper center", ncols=5, fontsize="small", handlelength=1.0)
    fastest = settings.top_speed
    for ax, surface, scale, title in (
        (speed, rules.speed(), fastest, "speed, m/s"),
        (gear, rules.gear(), settings.max_gain, "gain"),
    ):
        shown = ax.contourf(*grid(surface), scale * np.array(values(surface)), levels=20)
        figure.colorbar(shown, ax=ax)
        ax.set_title(title)
    speed.set(xlabel="ahead, m", ylabel="velocity ahead, m/s")
    gear.set(xlabel="left, m", ylabel="velocity to the left, m/s")


def grid(surface: Surface) -> tuple[list[float], list[float]]:
    """Both inputs over their domains."""
    first, second = (np.linspace(*domain, FINE) for domain in (surface.first, surface.second))
    return first.tolist(), second.tolist()


def values(surface: Surface) -> list[list[float]]:
    """What the robot looks up there; a row for each second input."""
    first, second = grid(surface)
    return [[surface.at(a, b) for a in first] for b in second]
