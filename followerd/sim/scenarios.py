"""A scenario: the place, the light, the robot's imperfections and the people in it, from YAML.

A number that may differ from seed to seed is written as one value or as `[low, high]`.
"""

from functools import cache
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from followerd import settings
from followerd.errors import UsageError
from followerd.resources import shipped
from followerd.settings import Settings


def _ordered(span: tuple[float, float]) -> tuple[float, float]:
    if span[0] > span[1]:
        raise ValueError("the first of the two must be the smaller")
    return span


Span = float | Annotated[tuple[float, float], AfterValidator(_ordered)]
Colour = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$", description="#rrggbb")]
Point = tuple[float, float]  # x, y in m
Surface = Literal["plain", "plaster", "brick", "wood", "metal", "tiles", "carpet", "books"]
Pattern = Literal["plain", "stripes", "hoops", "checks", "heather", "denim"]


def draw(span: Span, rng: np.random.Generator) -> float:
    """The value, or one drawn uniformly between the two."""
    if isinstance(span, tuple):
        return float(rng.uniform(*span))
    return float(span)


class Look(Settings):
    """What a surface looks like."""

    texture: Surface = "plain"
    colour: Colour = "#c8c4bc"


Heat = Annotated[int, Field(ge=0, le=255, description="grey level in thermal images")]


class Wall(Settings):
    """Upright walls along a line of points; seen from both sides."""

    points_m: tuple[Point, ...] = Field(min_length=2)
    height_m: float = Field(2.5, gt=0)
    look: Look = Look(texture="plaster", colour="#c9c2b4")
    doors_m: tuple[float, ...] = Field(
        (), description="distance along the line of each door's middle"
    )
    door_colour: Colour = "#7a5236"


class Block(Settings):
    """A box standing, or hanging `bottom_m` above the floor."""

    x_m: float
    y_m: float
    yaw_deg: float = 0.0
    length_m: float = Field(gt=0, description="along its own x")
    width_m: float = Field(gt=0, description="along its own y")
    height_m: float = Field(gt=0, description="top above the floor")
    bottom_m: float = Field(0.0, ge=0)
    look: Look = Look(texture="wood", colour="#9a7b55")
    heat: Heat = 70

    @model_validator(mode="after")
    def _top_above_bottom(self) -> "Block":
        if self.bottom_m >= self.height_m:
            raise ValueError("bottom_m must be below height_m")
        return self


class Column(Settings):
    """An upright cylinder: a pillar, a bin, a plant pot."""

    x_m: float
    y_m: float
    radius_m: float = Field(gt=0)
    height_m: float = Field(gt=0)
    look: Look = Look()
    heat: Heat = 70


class Cloth(Settings):
    """A piece of clothing."""

    pattern: Pattern = "plain"
    colour: Colour
    second: Colour = "#e8e8e8"  # of the pattern


class Outfit(Settings):
    """What one person wears, with the hair."""

    upper: Cloth
    lower: Cloth
    shoes: Colour = "#2a2622"
    hair: Colour = "#3a2a1c"
    skin: Colour = "#c79a7c"


class Stop(Settings):
    """A way point; the walker rounds it, or stands there for `pause_s`."""

    x_m: Span
    y_m: Span
    speed_mps: Span = Field((0.5, 0.9), description="on the way to this point")
    pause_s: Span = 0.0


class Arc(Settings):
    """To and fro around a point, for ever: a target that turns back suddenly (Motai's)."""

    x_m: float = 0.0
    y_m: float = 0.0
    radius_m: Span = 2.5
    start_deg: Span = 0.0
    rate_dps: Span = Field((12.0, 25.0), description="as seen from the point")
    accel_dps2: float = Field(60.0, gt=0)
    reversal_s: Span = Field((1.2, 2.2), description="time between two reversals")
    within_deg: float = Field(180.0, gt=0, description="turns back at this far from the start")


class Mover(Settings):
    """What persons and balls share: a way to go."""

    name: str
    target: bool = False
    path: tuple[Stop, ...] = ()
    arc: Arc | None = Field(None, description="instead of a path")
    facing_deg: Span = Field(0.0, description="where the path has one point only")
    start_after_s: Span = 4.0
    loop: bool = False
    corner_radius_m: float = Field(0.5, gt=0)

    @model_validator(mode="after")
    def _goes_one_way(self) -> "Mover":
        if bool(self.path) is (self.arc is not None):
            raise ValueError("give either a path or an arc")
        return self


class Person(Mover):
    """A walking or standing person."""

    height_m: Span = Field((1.6, 1.9))
    outfits: tuple[Outfit, ...] = Field((), description="one of them is drawn")
    crosses_m: Span | None = Field(
        None, description="sets out so as to cross the target's path that far behind the target"
    )
    backward: bool = Field(False, description="walks backward, facing where the path comes from")
    like_target: bool = Field(False, description="clothes in the target's colours, slightly off")

    @model_validator(mode="after")
    def _dressed(self) -> "Person":
        if not self.outfits and not self.like_target:
            raise ValueError("give outfits, or like_target: true")
        return self


class Ball(Mover):
    """A rolling ball."""

    radius_m: float = Field(0.12, gt=0)
    colour: Colour = "#c81e1e"
    heat: Heat = 75


class Robot(Settings):
    """Where the robot starts, and how far it is from the ideal one."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_deg: float = 0.0
    track_m: float = Field(0.357, gt=0, description="effective distance of the wheels")
    radius_m: float = Field(0.25, gt=0, description="of its footprint")
    wheel_error: float = Field(0.01, ge=0, lt=0.2, description="sigma of each wheel's size, ratio")
    slip: float = Field(0.02, ge=0, lt=0.5, description="sigma of the momentary slip, ratio")


class LightChange(Settings):
    """Lamps go on or off, or the exposure follows them."""

    at_s: Span = Field(description="when it begins")
    over_s: float = Field(0.3, gt=0, description="how long it takes")
    level: Span = Field(description="gain from then on")


class Light(Settings):
    """Exposure and sensor noise of the camera in this place."""

    level: Span = 1.0
    changes: tuple[LightChange, ...] = Field((), description="of the level, in the order of time")
    drift: float = Field(0.05, ge=0, lt=0.5, description="sigma of the exposure's slow drift")
    noise: float = Field(4.0, ge=0, description="sigma of the pixel noise, grey levels")
    exposure_s: float = Field(0.012, ge=0, description="shutter time, for motion blur")


class AutoGain(Settings):
    """A thermal camera that changes its gain and offset by itself, suddenly."""

    jumps_s: Span = Field((4.0, 9.0), description="time between two jumps")
    gain: Span = Field((0.75, 1.25), description="after a jump, over that at the start")
    offset: Span = Field((-20.0, 20.0), description="same, grey levels")


class Scenario(Settings):
    """Everything about a world but its seed."""

    name: str
    description: str = ""
    duration_s: float = Field(60.0, gt=0)
    task: Literal["follow", "fixate", "watch"] = Field(
        "follow", description="fixate: the robot only turns; watch: it never moves"
    )
    camera: str = Field("192x144@15", description="preset that suits it")
    floor: Look = Look(texture="tiles", colour="#8d8778")
    ceiling: Look | None = Look(colour="#d8d6d0")
    ceiling_m: float = Field(2.5, gt=0)
    light: Light = Light()
    auto_gain: AutoGain | None = Field(None, description="of a thermal camera; default: steady")
    robot: Robot = Robot()
    walls: tuple[Wall, ...] = ()
    boxes: tuple[Block, ...] = ()
    columns: tuple[Column, ...] = ()
    people: tuple[Person, ...] = ()
    balls: tuple[Ball, ...] = ()

    @model_validator(mode="after")
    def _one_target(self) -> "Scenario":
        if sum(mover.target for mover in (*self.people, *self.balls)) != 1:
            raise ValueError("exactly one of people and balls must have target: true")
        if any(p.like_target and (p.target or not self.target_is_person) for p in self.people):
            raise ValueError("like_target needs another person as the target")
        if any(p.crosses_m is not None and p.target for p in self.people):
            raise ValueError("the target cannot cross its own path: leave crosses_m out")
        return self

    @property
    def target_is_person(self) -> bool:
        """Whether a person, not a ball, is to be followed."""
        return any(person.target for person in self.people)


def known() -> list[str]:
    """Names of the scenarios that ship with the program."""
    return sorted(path.stem for path in shipped("worlds").glob("*.yaml"))


@cache
def _shipped(name: str) -> Scenario:
    """Read once: it is asked for several times, and parsing takes 20 ms."""
    if name not in known():
        raise UsageError(f"no scenario {name}; there are {', '.join(known())}")
    return settings.load(shipped("worlds", f"{name}.yaml"), Scenario)


def load(name_or_path: str | Path) -> Scenario:
    """A shipped scenario by name, or any by its file.

    Raises UsageError for an unknown name, ConfigError for a wrong file.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        return _shipped(str(name_or_path))
    return settings.load(path, Scenario)
