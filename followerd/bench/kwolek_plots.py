"""The pictures of suite `kwolek`: the ellipse on the first and last frame as in the paper's figure
5, and its size over the frames, with and without depth."""

from collections.abc import Sequence
from typing import Protocol

from matplotlib.figure import Figure

from followerd.geometry import Array
from followerd.messages import Pixels


class Seen(Protocol):
    """One tracker's view of a walk."""

    @property
    def scenario(self) -> str:
        """Of which case."""
        ...

    @property
    def tracker(self) -> str:
        """Which tracker."""
        ...

    @property
    def seed(self) -> int:
        """Of the walk."""
        ...

    @property
    def size(self) -> Array:
        """Half width, px."""
        ...

    @property
    def true_size(self) -> Array:
        """Same, as it really is."""
        ...

    @property
    def center_error(self) -> Array:
        """px."""
        ...

    @property
    def pictures(self) -> tuple[Pixels, ...]:
        """First and last frame."""
        ...


def plots(outcomes: Sequence[Seen]) -> dict[str, Figure]:
    """Of the first seed."""
    first = [o for o in outcomes if o.seed == outcomes[0].seed]
    shown = [o for o in first if o.scenario in ("E1", "E2-no-depth", "E1-crossed")]
    result = {f"size and place over the frames, seed {first[0].seed}": _over_frames(shown)}
    pictures = [o for o in first if o.pictures]
    if pictures:
        result["first and last frame, as in figure 5"] = _frames(pictures)
    return result


def _over_frames(outcomes: Sequence[Seen]) -> Figure:
    figure = Figure((9.0, 6.0), layout="constrained")
    sizes, errors = figure.subplots(2, 1, sharex=True)
    sizes.plot(outcomes[0].true_size, color="black", linewidth=1.4, label="true")
    for one in outcomes:
        label = f"{one.scenario} {one.tracker}"
        sizes.plot(one.size, linewidth=0.8, label=label)
        errors.plot(one.center_error, linewidth=0.8, label=label)
    sizes.set_ylabel("half width, px")
    errors.set(ylabel="error of the centre, px", xlabel="frame", ylim=(0, 20))
    sizes.legend(fontsize="x-small", ncols=2)
    return figure


def _frames(outcomes: Sequence[Seen]) -> Figure:
    figure = Figure((9.0, 3.5 * len(outcomes)), layout="constrained")
    axes = figure.subplots(len(outcomes), 2, squeeze=False)
    for row, one in zip(axes, outcomes, strict=True):
        for ax, picture in zip(row, one.pictures, strict=True):
            ax.imshow(picture[..., ::-1])
            ax.set_axis_off()
        row[0].set_title(f"{one.scenario} {one.tracker}", fontsize="small")
    return figure
