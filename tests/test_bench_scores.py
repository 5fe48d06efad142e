"""Boxes are scored as the tracking community scores them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followerd.bench.scores import OVERLAPS, as_array, overlap, read_truth, score
from followerd.errors import UsageError
from followerd.geometry import Array
from followerd.messages import Box

GRID = st.integers(0, 12)
SIDE = st.integers(1, 9)
whole_boxes = st.lists(st.tuples(GRID, GRID, SIDE, SIDE), min_size=1, max_size=6)


def pixels(box: tuple[int, int, int, int]) -> set[tuple[int, int]]:
    x, y, w, h = box
    return {(x + i, y + j) for i in range(w) for j in range(h)}


@given(whole_boxes, whole_boxes)
def test_overlap_is_what_counting_pixels_gives(
    a: list[tuple[int, int, int, int]], b: list[tuple[int, int, int, int]]
) -> None:
    n = min(len(a), len(b))
    counted = [
        len(pixels(p) & pixels(q)) / len(pixels(p) | pixels(q))
        for p, q in zip(a[:n], b[:n], strict=True)
    ]
    assert overlap(np.array(a[:n], float), np.array(b[:n], float)) == pytest.approx(counted)


def brute_force_auc(boxes: Array, truth: Array) -> float:
    curve = []
    for threshold in OVERLAPS:
        hits = visible = 0
        for box, right in zip(boxes, truth, strict=True):
            if np.isnan(right).any():
                continue
            visible += 1
            if not np.isnan(box).any():
                hits += bool(overlap(box[None], right[None])[0] > threshold)
        curve.append(hits / visible)
    return sum(curve) / len(curve)


@settings(max_examples=25)
@given(st.integers(0, 1000))
def test_the_scores_are_what_a_loop_over_frames_gives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = rng.uniform([0, 0, 10, 20], [100, 100, 40, 80], (30, 4))
    boxes = truth + rng.normal(0, 4, (30, 4)) * rng.integers(0, 2, (30, 1))
    truth[rng.random(30) < 0.2] = np.nan
    boxes[rng.random(30) < 0.2] = np.nan
    truth[0], truth[1], boxes[0] = (5, 5, 10, 10), np.nan, np.nan
    scores = score(boxes, truth)
    shown = ~np.isnan(truth[:, 0])
    close = [
        not np.isnan(b[0]) and np.hypot(*(b[:2] + b[2:] / 2 - t[:2] - t[2:] / 2)) <= 20
        for b, t in zip(boxes[shown], truth[shown], strict=True)
    ]
    assert scores.auc == pytest.approx(brute_force_auc(boxes, truth))
    assert scores.p20 == pytest.approx(np.mean(close))
    assert scores.claims_when_absent == pytest.approx(np.mean(~np.isnan(boxes[~shown, 0])))
    assert scores.visible_frames == shown.sum()


def test_perfect_boxes_score_all_but_the_last_threshold() -> None:
    truth = as_array([Box(1, 2, 30, 40), Box(5, 2, 30, 40)])
    scores = score(truth, truth)
    assert scores.auc == pytest.approx(20 / 21)  # no overlap is above 1
    assert (scores.p20, scores.iou) == (1.0, 1.0)


def test_what_the_truth_cannot_say_is_unknown() -> None:
    nobody = as_array([None, None])
    somebody = as_array([Box(0, 0, 5, 5), None])
    assert score(somebody, nobody).auc is None
    assert score(somebody, nobody).claims_when_absent == 0.5
    assert score(somebody, as_array([Box(0, 0, 5, 5)])).claims_when_absent is None


@pytest.mark.parametrize(
    ("name", "line", "box"),
    [
        ("groundtruth_rect.txt", "11,21,30,40", (10, 20, 30, 40)),
        ("groundtruth_rect.txt", "11\t21\t30\t40", (10, 20, 30, 40)),
        ("gt.txt", "10,20,40,60", (10, 20, 30, 40)),
        ("groundtruth.txt", "10,20,40,20,40,60,10,60", (10, 20, 30, 40)),
    ],
)
def test_the_three_forms_of_truth_give_the_same_box(
    tmp_path: Path, name: str, line: str, box: tuple[float, ...]
) -> None:
    (tmp_path / name).write_text(f"{line}\n\n{line}\n")
    assert read_truth(tmp_path / name).tolist() == [list(box), list(box)]


def test_an_absent_person_is_nan(tmp_path: Path) -> None:
    (tmp_path / "gt.txt").write_text("1,2,3,4\nNaN,NaN,NaN,NaN\n")
    assert np.isnan(read_truth(tmp_path / "gt.txt")[1]).all()


@pytest.mark.parametrize("text", ["", "1,2,3\n", "1,2,3,4\n1,2\n", "a,b,c,d\n"])
def test_a_file_that_is_no_truth_is_refused_by_name(tmp_path: Path, text: str) -> None:
    (tmp_path / "gt.txt").write_text(text)
    with pytest.raises(UsageError, match=r"--truth .*gt\.txt"):
        read_truth(tmp_path / "gt.txt")
    with pytest.raises(UsageError, match="--truth"):
        read_truth(tmp_path / "missing.txt")
