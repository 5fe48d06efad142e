"""Tables of what the config can choose by name; entry points extend them."""

from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from followerd.errors import ConfigError


class Registry:
    """Name in the config file -> "module:Class", imported only when chosen.

    A package outside the project adds a row by an entry point of the group. One that cannot be
    imported spoils only its own name.
    """

    def __init__(self, group: str, table: dict[str, str]) -> None:
        self.group = group
        self._table = table

    def names(self) -> list[str]:
        """All names, ours first."""
        others = [point.name for point in _installed(self.group) if point.name not in self._table]
        return [*self._table, *others]

    def load(self, name: str) -> Any:
        """The class of that name; raises ConfigError naming the known ones."""
        if name in self._table:
            module, _, attribute = self._table[name].partition(":")
            return getattr(import_module(module), attribute)
        for point in _installed(self.group):
            if point.name == name:
                try:
                    return point.load()
                except Exception as error:
                    raise ConfigError(
                        f"{self.group}: {name} is installed but broken: {error}"
                    ) from error
        raise ConfigError(f"{self.group}: no {name}; known are {', '.join(self.names())}")


@cache
def _installed(group: str) -> list[EntryPoint]:
    """What other packages add to a group; to look through all packages takes 10 ms."""
    return sorted(entry_points(group=group), key=lambda point: point.name)
