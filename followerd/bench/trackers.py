"""Trackers by the names that the command line and the rows use: `hpf`, `hpf/paper`."""

from typing import Any

import numpy as np
from pydantic import ValidationError

from followerd.config import Config
from followerd.errors import UsageError
from followerd.trackers.interfaces import Tracker
from followerd.trackers.registry import TRACKERS


def build(
    name: str, rng: np.random.Generator, config: Config | None = None, **changes: Any
) -> Tracker:
    """The tracker `KIND` or `KIND/PROFILE`, with the config's settings where it names that kind.

    `changes` overlay single settings. Raises UsageError for a name or a setting that is unknown.
    """
    kind, _, profile = name.partition("/")
    if kind not in TRACKERS.names():
        raise UsageError(f"--tracker {name}: unknown; there are {', '.join(TRACKERS.names())}")
    cls = TRACKERS.load(kind)
    values: dict[str, Any] = {}
    if config is not None:
        if config.tracker.kind != kind:
            raise UsageError(f"--tracker {name}: the config is for {config.tracker.kind}")
        values = config.tracker.model_dump(exclude={"kind"})
    if profile:
        values["profile"] = profile
    try:
        settings = cls.Settings(**(values | changes))
    except ValidationError as error:
        fault = error.errors()[0]
        where = ".".join(str(part) for part in fault["loc"])
        raise UsageError(f"--tracker {name}: {where}: {fault['msg']}") from None
    tracker: Tracker = cls(settings, rng)
    return tracker
