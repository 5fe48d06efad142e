"""What really is: for scoring and drawing only, never for the daemon."""

from dataclasses import dataclass

from followerd.geometry import Pose2
from followerd.messages import Twist


@dataclass(frozen=True, slots=True)
class Actor:
    """A person or ball as it really is."""

    name: str
    x: float  # m, in the world
    y: float  # m
    heading: float  # rad
    velocity: tuple[float, float]  # m/s, in the world
    distance: float  # m, from the robot's centre to the actor's axis
    bearing: float  # rad in `base`, left positive
    in_sight: bool  # neither wall nor other person hides it; the field of view is not asked


@dataclass(frozen=True, slots=True)
class Truth:
    """The world at one time."""

    stamp: float  # s, loop time
    pose: Pose2  # world_from_base
    twist: Twist
    target: Actor
    others: tuple[Actor, ...]
    collisions: int  # contacts that the robot caused
    bumped: int  # contacts that people caused, or who could not be seen for 1 s
    min_person_distance: float  # m, while the robot approached a person it could see for 1 s
    min_any_distance: float  # m, whoever approached; inf before the first look
