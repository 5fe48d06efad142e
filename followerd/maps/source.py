"""A map from whatever a lab has: ROS's form, or a floor plan of segments."""

from pathlib import Path

from followerd import yaml
from followerd.maps.files import load, yaml_of
from followerd.maps.floor import FloorMap
from followerd.maps.plan import read_plan


def open_map(path: Path) -> FloorMap:
    """The map in a file; raises ConfigError naming file and line."""
    file = yaml_of(path)
    document = yaml.read(file)
    is_grid = isinstance(document.value, dict) and "image" in document.value
    return load(path) if is_grid else read_plan(file)
