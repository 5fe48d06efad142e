"""Progress bars in the terminal."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

from rich.progress import Progress

T = TypeVar("T")


class Bars:
    """One bar for each piece of work.

    Not rich's own `track`: a thread of it outlives an error, and the garbage collector may then
    wait for that thread in the one that draws, for ever.
    """

    def __init__(self, progress: Progress) -> None:
        self._progress = progress

    def shown(self, items: Sequence[T], what: str) -> Iterator[T]:
        """The items, one after another, while a bar grows."""
        bar = self._progress.add_task(what, total=len(items))
        for item in items:
            yield item
            self._progress.advance(bar)
