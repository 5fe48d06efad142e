"""The base of every settings class; each stands beside the code it configures.

Keys carry their unit (`max_speed_mps`, `yaw_deg`, `stale_after_s`); values are converted to SI
(m, rad, s) where they are used. Unknown keys, infinities and NaN are errors.
"""

from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic_core import ErrorDetails

from followerd import yaml
from followerd.errors import ConfigError


class Settings(BaseModel):
    """Frozen, closed (no unknown keys), finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


S = TypeVar("S", bound=Settings)


def load(path: Path, kind: type[S]) -> S:
    """The settings in a YAML file; raises ConfigError with `file:line:column` of every fault."""
    return validate(yaml.read(path), kind)


def validate(document: yaml.Document, kind: type[S], context: dict[str, Any] | None = None) -> S:
    """The settings in a parsed document; raises ConfigError like `load`."""
    value = {} if document.value is None else document.value
    if not isinstance(value, dict):
        raise ConfigError(f"{document.at(())}: expected keys and values")
    try:
        return kind.model_validate(value, context=context)
    except ValidationError as error:
        raise ConfigError(*explain(document, error, kind)) from None


def explain(document: yaml.Document, error: ValidationError, kind: type[BaseModel]) -> list[str]:
    """One line per fault: place, key, what is wrong, what was given."""
    lines = []
    for fault in error.errors():
        path = _in_file(fault["loc"], document)
        key = ".".join(str(part) for part in path) or "file"
        lines.append(f"{document.at(path)}: {key}: {_say(fault, path, document, kind)}")
    return lines


def _in_file(loc: tuple[str | int, ...], document: yaml.Document) -> tuple[str | int, ...]:
    """The fault's location without the union tags that pydantic adds."""
    path: tuple[str | int, ...] = ()
    for part in loc[:-1]:
        if (*path, part) in document.places:
            path = (*path, part)
    is_tag = loc[-1:] == (_kind(path, document),)  # of a whole section
    return path if is_tag else (*path, *loc[-1:])


def _kind(path: tuple[str | int, ...], document: yaml.Document) -> object:
    """The `kind` of the section at `path`."""
    section = document.value
    for part in path:
        section = section[part]
    return section.get("kind") if isinstance(section, dict) else None


def _say(
    fault: ErrorDetails,
    path: tuple[str | int, ...],
    document: yaml.Document,
    kind: type[BaseModel],
) -> str:
    if fault["type"] == "extra_forbidden":
        close = get_close_matches(str(path[-1]), _keys(kind, path[:-1]) - {path[-1]}, 1)
        return "unknown key" + (f"; did you mean {close[0]}?" if close else "")
    if fault["type"] == "missing":
        return "is required"
    message = fault["msg"].removeprefix("Value error, ")
    message = message[:1].lower() + message[1:]
    if isinstance(fault["input"], dict | list) or path not in document.places:
        return message
    return f"{message} (got {fault['input']!r})"


def _keys(kind: type[BaseModel], path: tuple[str | int, ...]) -> set[str]:
    """Keys that may stand at `path`, of all members where it is a union."""
    kinds = [kind]
    for part in path:
        annotations = [
            k.model_fields[str(part)].annotation for k in kinds if part in k.model_fields
        ]
        kinds = [m for a in annotations for m in _models(a)]
    return {key for k in kinds for key in k.model_fields}


def _models(annotation: Any) -> list[type[BaseModel]]:
    """The settings classes inside an annotation such as `list[A | B] | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]
