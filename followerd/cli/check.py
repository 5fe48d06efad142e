"""`followerd check` and `followerd schema`: the config without a robot."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd.app import verify
from followerd.bench import surfaces
from followerd.config import Config, find, load
from followerd.config import schema as config_schema
from followerd.control.fuzzy_gears import FuzzyGearsSettings
from followerd.errors import UsageError


def check(
    config: str,
    *,
    picture: Annotated[
        Path | None,
        Parameter(help="draw the sets and surfaces of a fuzzy follow law into this *.png"),
    ] = None,
) -> None:
    """Validate a config file (or a shipped one, by name) and say what it sets up."""
    settings = load(config)
    verify(settings)
    if picture is not None:
        _draw(settings, picture)
    print(f"{find(config)}: good")
    for name in ("base", "laser", "camera", "ptz"):
        if device := getattr(settings, name):
            print(f"  {name}: {device.kind} at {device.link}")
    if settings.localizer:
        print(f"  localizer: {settings.localizer.kind} on {settings.localizer.map}")
    print(f"  tracker: {settings.tracker.kind}, controller: {settings.controller.kind}")
    if settings.simulated:
        print(f"  scenario: {settings.sim.scenario}")
    print(f"  operator: {settings.operator}")


def _draw(config: Config, path: Path) -> None:
    law = config.controller
    if law.kind != "fuzzy_gears":
        raise UsageError(f"--picture: a {law.kind} follow law has no surfaces; fuzzy_gears has")
    settings = FuzzyGearsSettings.model_validate(law.model_dump(exclude={"kind"}))
    try:
        surfaces.picture(settings).savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise UsageError(f"--picture {path}: cannot be written: {error}") from error


def schema() -> None:
    """Print the JSON Schema of the config; editors complete and check YAML with it."""
    print(json.dumps(config_schema().model_json_schema(), indent=2))
