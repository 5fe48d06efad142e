"""`followerd check` and `followerd schema`: the config without a robot."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from matplotlib.figure import Figure

from followerd.app import equipment, laser_settings, pipeline_settings, verify
from followerd.bench import fields, surfaces
from followerd.config import Config, find, load
from followerd.config import schema as config_schema
from followerd.control.fuzzy_gears import FuzzyGearsSettings
from followerd.errors import UsageError


def check(
    config: str,
    *,
    picture: Annotated[
        Path | None,
        Parameter(
            help="draw footprint, protective fields and fields of view into this *.png;"
            " of a fuzzy follow law also its sets and surfaces"
        ),
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
    fuzzy = law.kind == "fuzzy_gears"
    figure = Figure((12.0, 14.0) if fuzzy else (8.0, 9.0), layout="constrained")
    parts = figure.subfigures(1 + fuzzy, 1, squeeze=False, height_ratios=[9.0, 5.0][: 1 + fuzzy])
    guard, camera = pipeline_settings(config).guard, equipment(config).camera
    fields.draw(parts[0, 0].subplots(), guard, laser_settings(config), camera)
    if fuzzy:
        settings = FuzzyGearsSettings.model_validate(law.model_dump(exclude={"kind"}))
        surfaces.draw(parts[1, 0], settings)
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise UsageError(f"--picture {path}: cannot be written: {error}") from error


def schema() -> None:
    """Print the JSON Schema of the config; editors complete and check YAML with it."""
    print(json.dumps(config_schema().model_json_schema(), indent=2))
