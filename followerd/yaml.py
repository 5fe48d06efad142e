"""YAML 1.2's core schema with the place of every value, so that each fault names its line.

YAML 1.1's traps are gone: only `true`/`false` are booleans (`on`, `yes` are text), `1e3` is a
number, `12:30` is text; a number with a leading zero and a duplicate key are errors.
"""

import re
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from followerd.errors import ConfigError

INT = re.compile(r"[-+]?(0|[1-9][0-9]*)$")
OCTAL_LOOKING = re.compile(r"[-+]?0[0-9]+$")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?$")


class Place(NamedTuple):
    """Where something stands in the file, counted from 1."""

    line: int
    column: int


Path_ = tuple[str | int, ...]


class Document(NamedTuple):
    """Plain values and the place of each key or item, by its path."""

    source: str
    value: Any
    places: dict[Path_, Place]

    def at(self, path: Path_) -> str:
        """`file:line:column` of `path`, or of its nearest parent that stands in the file."""
        while path and path not in self.places:
            path = path[:-1]
        place = self.places.get(path, Place(1, 1))
        return f"{self.source}:{place.line}:{place.column}"


def parse(text: str, source: str) -> Document:
    """Values of a YAML text; raises ConfigError naming every fault found."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigError(f"{source}{place}: not valid YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{source}: not valid YAML: {error}") from None
    places: dict[Path_, Place] = {}
    problems: list[str] = []
    value = None if node is None else _construct(node, (), places, problems, source)
    if problems:
        raise ConfigError(*problems)
    return Document(source, value, places)


def read(path: Path) -> Document:
    """Like `parse`, of a file."""
    try:
        return parse(path.read_text(encoding="utf-8"), str(path))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None


def _construct(
    node: yaml.Node, path: Path_, places: dict[Path_, Place], problems: list[str], source: str
) -> Any:
    mark = node.start_mark
    places.setdefault(path, Place(mark.line + 1, mark.column + 1))
    if isinstance(node, yaml.SequenceNode):
        return [
            _construct(item, (*path, i), places, problems, source)
            for i, item in enumerate(node.value)
        ]
    if isinstance(node, yaml.MappingNode):
        mapping: dict[str, Any] = {}
        for key_node, value_node in node.value:
            here = f"{source}:{key_node.start_mark.line + 1}:{key_node.start_mark.column + 1}"
            if not isinstance(key_node, yaml.ScalarNode):
                problems.append(f"{here}: a key must be a word")
                continue
            key = str(key_node.value)
            if key in mapping:
                problems.append(f"{here}: {key} stands here twice; remove one")
            places[(*path, key)] = Place(
                key_node.start_mark.line + 1, key_node.start_mark.column + 1
            )
            mapping[key] = _construct(value_node, (*path, key), places, problems, source)
        return mapping
    text = str(node.value)
    if isinstance(node, yaml.ScalarNode) and node.style is not None:
        return text
    if OCTAL_LOOKING.match(text):
        problems.append(
            f"{source}:{mark.line + 1}:{mark.column + 1}: {text}: a number must not begin with 0"
            " (quote it if it is text)"
        )
        return None
    return _scalar(text)


def _scalar(text: str) -> Any:
    if text in ("", "~", "null"):
        return None
    if text in ("true", "false"):
        return text == "true"
    if INT.match(text):
        return int(text)
    if FLOAT.match(text):
        return float(text)
    return text
