"""The window around a person, what it says of their colours, and the spectra of its cells."""

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followerd.messages import Pixels
from followerd.perception.maps import LEAST_SEEN, RING, contrast, reach, sampled
from followerd.perception.template import Fourier, Template
from followerd.perception.window import BODY, SIDE, Window


def smooth(width: int, height: int) -> Pixels:
    """An image in which neighbours differ little."""
    rng = np.random.default_rng(2)
    coarse = rng.integers(0, 256, (3, 4, 3), dtype=np.uint8)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.uint8)


@pytest.mark.parametrize("size", [12.0, 40.0, 60.0, 110.0, 200.0])
@pytest.mark.parametrize("middle", [(96.0, 72.0), (8.5, 130.0), (190.0, 3.0), (-15.0, 150.0)])
def test_a_window_shows_the_image_where_it_says(size: float, middle: tuple[float, float]) -> None:
    image = smooth(192, 144)
    window = Window.around(np.array([*middle, size, size]), (192, 144))
    patch = window.cut(image)
    assert patch.shape == (SIDE, SIDE, 3)
    grid = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2) + 0.5
    x, y = (window.to_image(grid) - 0.5).astype(np.float32).T.reshape(2, SIDE, SIDE)
    expected = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # a large window shows means of several pixels
    error = np.abs(patch.astype(float) - expected)[window.inside()]
    assert error.mean() < (1.0 if window.scale < 2.0 else 3.0)


def test_what_lies_outside_the_image_is_known() -> None:
    window = Window.around(np.array([10.0, 72.0, BODY, BODY]), (192, 144))
    rows, columns = window.inside()
    assert (rows.start, rows.stop) == (0, SIDE)
    assert (columns.start, columns.stop) == (26, SIDE)


spans = st.tuples(st.integers(0, 20), st.integers(0, 20)).map(lambda s: slice(s[0], 20 + s[1]))


@settings(max_examples=30)
@given(spans, spans, st.floats(4.0, 30.0), st.floats(4.0, 30.0))
def test_contrast_is_the_mean_in_a_box_less_half_that_around_it(
    rows: slice, columns: slice, w: float, h: float
) -> None:
    values = np.zeros((40, 40), np.float32)
    values[rows, columns] = np.random.default_rng(3).normal(size=(40, 40))[rows, columns]
    found = contrast(values, (rows, columns), w, h)
    for y, x in ((20, 20), (3, 30), (39, 0)):
        sums, counts, areas = [], [], []
        for factor in (1.0, RING):
            half_w, half_h = int(0.5 * factor * w), int(0.5 * factor * h)
            box = np.zeros((40, 40), bool)
            box[max(y - half_h, 0) : y + half_h + 1, max(x - half_w, 0) : x + half_w + 1] = True
            sums.append(float(values[box].sum()))
            counts.append(int(box[rows, columns].sum()))
            areas.append((2 * half_w + 1) * (2 * half_h + 1))
        inside = sums[0] / max(counts[0], LEAST_SEEN * areas[0])
        ring, area = counts[1] - counts[0], areas[1] - areas[0]
        around = (sums[1] - sums[0]) / max(ring, LEAST_SEEN * area)
        assert found[y, x] == pytest.approx(inside - 0.5 * around, abs=1e-4)


def test_edges_are_where_the_persons_colours_end() -> None:
    values = np.full((72, 72), -1.0, np.float32)
    values[20:60, 25:50] = 1.0
    assert reach(values, 36.0, 40.0, 24.0, 38.0) == [11.0, 20.0, 14.0, 20.0]


def random_cells(planes: int) -> npt.NDArray[np.float32]:
    """Planes (planes, 24, 24) without the highest frequency, which cannot be moved."""
    rough = np.random.default_rng(4).normal(size=(planes, 24, 24))
    return (rough + np.roll(rough, 1, 1) + np.roll(rough + np.roll(rough, 1, 1), 1, 2)).astype(
        np.float32
    )


def test_spectra_are_those_of_the_fast_transform_and_back() -> None:
    cells = random_cells(3)
    fourier = Fourier(24)
    spectra = fourier(cells)
    assert spectra == pytest.approx(np.fft.rfft2(cells), abs=1e-3)
    assert fourier.inverse(spectra) == pytest.approx(cells, abs=1e-4)
    moved = fourier.inverse(spectra * fourier.shift(3.0, -5.0))
    assert moved == pytest.approx(np.roll(cells, (-5, 3), (1, 2)), abs=1e-4)


def test_a_template_answers_where_its_person_went() -> None:
    cells = random_cells(9)
    template = Template(cells, (6.0, 12.0))
    moved = np.roll(cells, (2, -3), (1, 2))
    row, column = divmod(int(template.respond(template.spectrum(moved)).argmax()), 24)
    assert (column, row) in {(8, 13), (9, 13), (8, 14), (9, 14)}  # 11.5 - 3, 11.5 + 2
    there, elsewhere = (
        template.slow_answers(moved, offset, (1.0,))[0] for offset in ((-3.0, 2.0), (4.0, -4.0))
    )
    assert there > 3.0 * abs(elsewhere)
    spectrum = template.spectrum(moved)
    assert template.vouch(spectrum, there) > 5.0 > template.vouch(spectrum, elsewhere)


def test_any_number_of_points_is_sampled() -> None:
    rng = np.random.default_rng(4)
    values = rng.random((40, 40)).astype(np.float32)
    points = rng.uniform(-2.0, 42.0, (100_000, 2))
    found = sampled(values, points)
    assert found.shape == (100_000,)
    picked = rng.integers(0, 100_000, 50)
    assert np.array_equal(found[picked], sampled(values, points[picked]))
