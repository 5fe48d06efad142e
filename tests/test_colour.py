"""Colours of a person: the paper's interval, the ratio to the surroundings, the clicked region."""

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from followerd.errors import UsageError
from followerd.messages import Box, Pixels
from followerd.perception import colour
from followerd.perception.region import region_of


def picture(person: tuple[int, int, int], ground: tuple[int, int, int], noise: float) -> Pixels:
    """A person of one colour (BGR) at columns 80-110, rows 40-110 of 192x144."""
    image = np.empty((144, 192, 3))
    image[:] = ground
    image[40:110, 80:110] = person
    image += np.random.default_rng(3).normal(0.0, noise, image.shape)
    return np.clip(image, 0, 255).astype(np.uint8)


PERSON = Box(80.0, 40.0, 30.0, 70.0)
RED, GREY, BLACK, BLUE = (30, 30, 190), (128, 128, 128), (25, 25, 25), (180, 60, 40)


def inside_and_outside(values: npt.NDArray[np.generic]) -> tuple[float, float]:
    flags = np.zeros(values.shape, bool)
    flags[42:108, 82:108] = True
    return float(values[flags].mean()), float(values[~flags].mean())


def test_the_table_agrees_with_the_thresholds_themselves() -> None:
    model = colour.ColourInterval(hue=3.0, reach=12.0, saturation=90.0, value=60.0)
    image = np.random.default_rng(1).integers(0, 256, (100, 100, 3), dtype=np.uint8)
    middle = (image & 0xF8) + 4  # the table knows 5 bits of each channel
    h, s, v = cv2.split(cv2.cvtColor(middle, cv2.COLOR_BGR2HSV))
    expected = model.accepts(h.astype(float), s.astype(float), v.astype(float))
    assert np.array_equal(model.classify(colour.encode(image)), expected.astype(np.uint8))


def test_red_wraps_around_the_hue_circle() -> None:
    model = colour.ColourInterval(hue=178.0, reach=8.0, saturation=50.0, value=40.0)
    hue, rest = np.array([179.0, 2.0, 20.0]), np.full(3, 200.0)
    assert model.accepts(hue, rest, rest).tolist() == [True, True, False]


@pytest.mark.parametrize("person", [RED, BLUE])
def test_an_interval_learnt_from_a_box_finds_those_pixels(person: tuple[int, int, int]) -> None:
    image = picture(person, GREY, 6.0)
    mask = colour.ColourInterval.learn(image, PERSON).classify(colour.encode(image))
    inside, outside = inside_and_outside(mask)
    assert inside > 0.95
    assert outside < 0.03


@pytest.mark.parametrize(("person", "ground"), [(RED, GREY), (BLACK, GREY), (GREY, BLACK)])
def test_the_ratio_tells_any_clothes_from_their_surroundings(
    person: tuple[int, int, int], ground: tuple[int, int, int]
) -> None:
    image = picture(person, ground, 6.0)
    codes = colour.encode(image)
    inner = colour.histogram(codes[40:110, 80:110])
    model = colour.ColourRatio()
    model.learn(inner, colour.histogram(codes) - inner, 1.0)
    inside, outside = inside_and_outside(model.log_ratio(codes))
    assert inside > 1.0
    assert outside < -0.5


def test_a_model_that_learns_slowly_keeps_what_it_knew() -> None:
    red, blue = (colour.encode(picture(c, GREY, 6.0)) for c in (RED, BLUE))
    model = colour.ColourRatio()
    for codes, rate in ((red, 1.0), (blue, 0.03)):
        inner = colour.histogram(codes[40:110, 80:110])
        model.learn(inner, colour.histogram(codes) - inner, rate)
    assert inside_and_outside(model.log_ratio(red))[0] > 1.0


@pytest.mark.parametrize("person", [RED, BLACK, BLUE])
def test_a_click_grows_to_the_clothes_it_hit(person: tuple[int, int, int]) -> None:
    box = region_of(picture(person, GREY, 5.0), (95.0, 75.0))
    assert (box.x, box.y, box.w, box.h) == pytest.approx((80, 40, 30, 70), abs=4)


def test_a_click_on_a_plain_wall_gives_a_person_shaped_box() -> None:
    box = region_of(picture(GREY, GREY, 5.0), (95.0, 75.0))
    assert box.w < 0.2 * 192 < box.h * 2.0
    assert box.centre == pytest.approx((95.0, 75.0))


def test_a_box_over_the_border_is_cut_to_the_image() -> None:
    assert region_of(picture(RED, GREY, 5.0), Box(-5.0, 40.0, 30.0, 50.0)) == Box(0, 40, 25, 50)


@pytest.mark.parametrize(
    "region",
    [
        (200.0, 50.0),
        (50.0, -1.0),
        Box(300.0, 10.0, 20.0, 40.0),
        Box(-25.0, 10.0, 30.0, 40.0),
        Box(10.0, 10.0, 2.0, 40.0),
        Box(10.0, 10.0, -20.0, 40.0),
        Box(float("nan"), 10.0, 20.0, 40.0),
    ],
)
def test_regions_outside_the_image_are_refused(region: Box | tuple[float, float]) -> None:
    with pytest.raises(UsageError, match=r"outside the image|too small"):
        region_of(picture(RED, GREY, 5.0), region)
