"""Nouns to plain JSON values and back, to the last bit.

A dataclass becomes an object that names its class under `kind`; an array its base64 bytes; a float
that is no number, which JSON lacks, its name.
"""

import types
from base64 import b64decode, b64encode
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite
from typing import Any, Union, get_args, get_origin, get_type_hints
from zlib import crc32

import numpy as np

WORDS = (str, int)  # and bool, an int; JSON has them as they are

Plain = None | bool | int | float | str | list[Any] | dict[str, Any]
Way = Callable[[Any, bool], Plain]


def plain(value: object, *, digests: bool = False) -> Plain:
    """`value` as JSON has it; with `digests` arrays become checksums: enough to compare by."""
    return _plain(value, digests)


def _plain(value: object, digests: bool) -> Plain:
    """What happens 2,000 times a second: a table by type, not a chain of questions."""
    if isinstance(value, float):
        return float(value) if isfinite(value) else str(float(value))
    if value is None or isinstance(value, WORDS):
        return value
    return WAYS[type(value)](value, digests)


class _Ways(dict[type, Way]):
    """How values of a type are made plain."""

    def __missing__(self, kind: type) -> Way:
        self[kind] = _way(kind)
        return self[kind]


WAYS = _Ways()


def _way(kind: type) -> Way:
    if issubclass(kind, Enum):
        return lambda value, digests: _plain(value.value, digests)
    if issubclass(kind, bytes):
        return lambda value, _: b64encode(value).decode()
    if issubclass(kind, np.ndarray):
        return lambda value, digests: _digest(value) if digests else _array(value)
    if issubclass(kind, np.generic):
        return lambda value, digests: _plain(value.item(), digests)
    if issubclass(kind, list | tuple):
        return lambda value, digests: [_plain(item, digests) for item in value]
    if issubclass(kind, Mapping):
        return lambda value, digests: {str(k): _plain(v, digests) for k, v in value.items()}
    if is_dataclass(kind):
        return _way_of_noun(kind)
    raise TypeError(f"{kind.__name__} cannot be recorded")


def _way_of_noun(kind: type) -> Way:
    name, names = kind.__name__, _names(kind)

    def way(value: Any, digests: bool) -> Plain:
        found: dict[str, Any] = {"kind": name}
        for each in names:
            found[each] = _plain(getattr(value, each), digests)
        return found

    return way


def restored(hint: Any, value: Any) -> Any:
    """What `plain` was given, from its type.

    Raises ValueError, TypeError or KeyError when `value` is none of that type.
    """
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        return _one_of(get_args(hint), value)
    if origin is np.ndarray:
        return _restored_array(value)
    if origin is tuple:
        kinds = get_args(hint)
        if len(kinds) == 2 and kinds[1] is Ellipsis:
            return tuple(restored(kinds[0], item) for item in value)
        return tuple(restored(kind, item) for kind, item in zip(kinds, value, strict=True))
    if hint is float:
        return float(value)
    if hint is bytes:
        return b64decode(value, validate=True)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return hint(value)
    if isinstance(hint, type) and is_dataclass(hint):
        if value["kind"] != hint.__name__:
            raise ValueError(f"{value['kind']} where {hint.__name__} was expected")
        hints = _hints(hint)
        return hint(**{k: restored(hints[k], v) for k, v in value.items() if k != "kind"})
    if isinstance(hint, type) and isinstance(value, hint):
        return value
    raise ValueError(f"{value!r} is no {hint}")


def _one_of(kinds: tuple[Any, ...], value: Any) -> Any:
    if value is None and types.NoneType in kinds:
        return None
    named = isinstance(value, dict) and value.get("kind")
    for kind in kinds:
        if isinstance(kind, type) and is_dataclass(kind) and named == kind.__name__:
            return restored(kind, value)
    rest = [k for k in kinds if k is not types.NoneType and not is_dataclass(k)]
    if named or not rest:
        raise ValueError(f"{named or value!r} is none of {kinds}")
    return restored(rest[0], value)


@cache
def _names(kind: type) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind) if field.init)


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _array(value: np.ndarray) -> dict[str, Any]:
    data = b64encode(np.ascontiguousarray(value).tobytes()).decode()
    return {"dtype": value.dtype.str, "shape": list(value.shape), "base64": data}


def _digest(value: np.ndarray) -> str:
    return f"{value.dtype.str} {value.shape} {crc32(np.ascontiguousarray(value).tobytes()):08x}"


def _restored_array(value: Any) -> np.ndarray:
    flat = np.frombuffer(b64decode(value["base64"], validate=True), np.dtype(value["dtype"]))
    return flat.reshape(value["shape"]).copy()
