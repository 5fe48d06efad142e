"""Pictures of a recording."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from followerd.record.digest import Digest

CURVES = {
    "range_m": "range, m",
    "bearing_deg": "bearing, °",
    "speed_mps": "commanded speed, m/s",
    "turn_degps": "commanded turn, °/s",
    "confidence": "confidence",
}


def plots(found: Digest) -> dict[str, Figure]:
    """One figure: the curves over time with the modes below, and the ways from above."""
    figure = Figure(figsize=(11, 11), layout="constrained")
    axes = figure.subplot_mosaic(
        [[name, "ways"] for name in (*CURVES, "modes")], width_ratios=(3, 2)
    )
    for name, label in CURVES.items():
        axes[name].plot(found.times, found.curves[name], linewidth=0.9)
        axes[name].set_ylabel(label)
        axes[name].sharex(axes["modes"])
        axes[name].grid(alpha=0.3)
        axes[name].tick_params(labelbottom=False)
    _modes(axes["modes"], found)
    _ways(axes["ways"], found)
    return {"Run": figure}


def _modes(axes: Axes, found: Digest) -> None:
    names = list(dict.fromkeys(found.modes))
    levels = [names.index(mode) for mode in found.modes]
    axes.step(found.times, levels, where="post")
    axes.set_yticks(range(len(names)), names)
    axes.set_xlabel("time, s")
    axes.grid(alpha=0.3)


def _ways(axes: Axes, found: Digest) -> None:
    for points, label in ((found.path, "robot"), (found.person, "person")):
        if points:
            x, y = np.array(points).T
            axes.plot(x, y, label=label, linewidth=1.2)
            axes.plot(x[-1], y[-1], "o", markersize=5, color=axes.lines[-1].get_color())
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x in odom, m")
    axes.set_ylabel("y in odom, m")
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend()
