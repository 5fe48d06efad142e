"""`followerd check` and `followerd schema`: the config without a robot."""

import json

from followerd.app import verify
from followerd.config import find, load
from followerd.config import schema as config_schema


def check(config: str) -> None:
    """Validate a config file (or a shipped one, by name) and say what it sets up."""
    settings = load(config)
    verify(settings)
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


def schema() -> None:
    """Print the JSON Schema of the config; editors complete and check YAML with it."""
    print(json.dumps(config_schema().model_json_schema(), indent=2))
