"""Whom a click in a picture means."""

from math import radians

import numpy as np
import pytest

from followerd.errors import UsageError
from followerd.geometry import Camera, Pose2
from followerd.messages import Box, Image
from followerd.perception.body_outline import body_box
from followerd.perception.head_outline import head_box
from followerd.runtime.pointing import Pointing
from tests.laser_scenes import legs, scan_of

CAMERA = Camera.from_hfov(192, 144, 0.84, z=0.6)
PERSON, OTHER = (2.0, 0.3), (3.0, -0.6)
SEEN = np.vstack([legs(PERSON, 0.0), legs(OTHER, 0.0)])


def image(depth: bool = False) -> Image:
    """A picture of nothing."""
    known = np.full((144, 192), 2.0, np.float32) if depth else None
    return Image(7, 1.0, 1.02, np.zeros((144, 192, 3), np.uint8), CAMERA, known)


def pointing(*, heads: bool = False) -> Pointing:
    """The robot turned 20 degrees left between the scan, in which both stand, and the picture."""

    def ego_at(stamp: float) -> Pose2:
        return Pose2(theta=radians(20.0) if stamp > 0.95 else 0.0)

    watching = Pointing(ego_at, heads=heads)
    watching.measured(scan_of(SEEN, 0.9))
    return watching


def seen_by_now(person: tuple[float, float]) -> tuple[float, float]:
    """Where somebody of the scan stands in `base` when the picture is taken."""
    return (~Pose2(theta=radians(20.0))).apply_point(*person)


@pytest.mark.parametrize("height", [0.2, 1.0])
def test_the_outline_stands_where_the_legs_are_in_that_picture(height: float) -> None:
    x, y = seen_by_now(PERSON)
    column, row, _ = CAMERA.project(np.array([[x, y, height]]))[0].tolist()
    found, expected = pointing().meant(image(), (column, row)), body_box(CAMERA, x, y)
    assert isinstance(found, Box)
    assert found.foot == pytest.approx(expected.foot, abs=2.0)
    assert found.w == pytest.approx(expected.w, abs=2.0)


def test_a_tracker_of_heads_is_shown_the_head() -> None:
    x, y = seen_by_now(PERSON)
    column = CAMERA.project(np.array([[x, y, 1.0]]))[0, 0]
    found, expected = pointing(heads=True).meant(image(), (column, 3.0)), head_box(image(), x, y)
    assert isinstance(found, Box)
    assert found.centre == pytest.approx(expected.centre, abs=2.0)


def test_where_the_laser_sees_nobody_a_box_is_asked_for() -> None:
    with pytest.raises(UsageError, match="drag a box"):
        pointing().meant(image(), (5.0, 70.0))


def test_what_the_tracker_makes_more_of_is_left_to_it() -> None:
    watching, box, click = pointing(), Box(1.0, 2.0, 30.0, 40.0), (5.0, 70.0)
    assert watching.meant(image(), box) is box
    assert watching.meant(image(depth=True), click) is click
    assert watching.meant(image(), (500.0, 70.0)) == (500.0, 70.0)  # it says what is wrong
    assert Pointing(lambda _: None).meant(image(), click) is click  # no laser
