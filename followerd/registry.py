"""Tables of what the config can choose by name; entry points extend them."""

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
        return [*self._table, *(p.name for p in self._points() if p.name not in self._table)]

    def load(self, name: str) -> Any:
        """The class of that name; raises ConfigError naming the known ones."""
        if name in self._table:
            module, _, attribute = self._table[name].partition(":")
            return getattr(import_module(module), attribute)
        for point in self._points():
            if point.name == name:
                try:
                    return point.load()
                except Exception as error:
                    raise ConfigError(
                        f"{self.group}: {name} is installed but broken: {error}"
                    ) from error
        raise ConfigError(f"{self.group}: no {name}; known are {', '.join(self.names())}")

    def _points(self) -> list[EntryPoint]:
        return sorted(entry_points(group=self.group), key=lambda point: point.name)
