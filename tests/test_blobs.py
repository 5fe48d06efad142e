"""Masks become rectangles; blobs that swallow a person are offered in parts."""

import numpy as np
import pytest

from followerd.perception import blobs


def mask(*boxes: tuple[int, int, int, int]) -> blobs.Mask:
    image = np.zeros((60, 80), np.uint8)
    for x, y, w, h in boxes:
        image[y : y + h, x : x + w] = 1
    return image


def test_regions_are_their_bounding_boxes_largest_first() -> None:
    found = blobs.rectangles(mask((10, 10, 6, 8), (40, 20, 12, 20)), 0, 10)
    assert found.tolist() == [[46.0, 30.0, 12.0, 20.0], [13.0, 14.0, 6.0, 8.0]]


def test_speckle_and_small_regions_are_dropped() -> None:
    found = blobs.rectangles(mask((5, 5, 1, 9), (20, 20, 4, 4), (40, 20, 12, 20)), 0, 30)
    assert len(found) == 1


def test_diagonal_neighbours_are_one_region() -> None:
    assert len(blobs.rectangles(mask((10, 10, 5, 5), (15, 15, 5, 5)), 0, 10)) == 1


@pytest.mark.parametrize(("close", "regions"), [(0, 2), (7, 1)])
def test_two_trouser_legs_are_closed_into_one(close: int, regions: int) -> None:
    assert len(blobs.rectangles(mask((20, 10, 6, 30), (30, 10, 6, 30)), close, 30)) == regions


def test_an_empty_mask_has_no_regions() -> None:
    assert blobs.rectangles(mask(), 5, 30).shape == (0, 4)


def test_a_merged_blob_is_offered_flush_left_flush_right_and_as_predicted() -> None:
    blob = np.array([[50.0, 30.0, 40.0, 40.0]])
    parts = blobs.split(blob, np.array([45.0, 30.0, 20.0, 40.0]))
    assert parts[:, 0].tolist() == [50.0, 40.0, 60.0, 45.0]
    assert parts[1:, 1:].tolist() == [[30.0, 20.0, 40.0]] * 3


def test_the_parts_stand_on_the_blobs_lower_edge() -> None:
    parts = blobs.split(np.array([[50.0, 30.0, 40.0, 60.0]]), np.array([45.0, 40.0, 20.0, 40.0]))
    assert parts[1:, 1] + 0.5 * parts[1:, 3] == pytest.approx([60.0] * 3)


@pytest.mark.parametrize("predicted", [(45, 30, 38, 40), (400, 30, 20, 40), (45, 30, 20, 90)])
def test_blobs_of_the_right_width_or_elsewhere_are_left_whole(
    predicted: tuple[float, ...],
) -> None:
    blob = np.array([[50.0, 30.0, 40.0, 40.0]])
    assert len(blobs.split(blob, np.array(predicted, float))) == 1
