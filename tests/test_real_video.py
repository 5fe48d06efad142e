"""The default profile on recorded people; slow, and only beside the shared recordings."""

from math import radians
from pathlib import Path

import cv2
import numpy as np
import pytest

from followerd.geometry import Array, Camera
from followerd.messages import Box, Image, TrackPhase
from followerd.trackers.hpf import Hpf, HpfSettings

RECORDINGS = Path(__file__).parents[2] / "shared" / "data" / "colour"
FRAME_RATE = 25.0

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings at ../shared/data/colour"),
]


def truth(name: str) -> Array:
    """Boxes (N, 4): x y w h of the top left corner; nan where the person is out of view."""
    if (file := RECORDINGS / name / "gt.txt").exists():
        corners = np.genfromtxt(file, delimiter=",")
        return np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
    text = (RECORDINGS / name / "groundtruth_rect.txt").read_text().replace("\t", ",")
    boxes = np.array([[float(v) for v in line.split(",")] for line in text.split()])
    boxes[:, :2] -= 1.0
    return np.asarray(boxes, float)


def tracked(name: str, first: Array) -> Array:
    """Boxes (N, 4) of the default profile; nan where it says lost."""
    out = []
    tracker = Hpf(HpfSettings(), np.random.default_rng(0))
    files = sorted((RECORDINGS / name / "img").iterdir())
    for number, file in enumerate(files):
        pixels = np.asarray(cv2.imread(str(file)), np.uint8)
        camera = Camera.from_hfov(pixels.shape[1], pixels.shape[0], radians(48))
        image = Image(number, number / FRAME_RATE, number / FRAME_RATE, pixels, camera)
        if number == 0:
            state = tracker.enrol(image, Box(*first), None)
        else:
            step = tracker.step(image, None)
            assert step is not None
            state = step
        box = state.box if state.phase is not TrackPhase.LOST else None
        out.append((box.x, box.y, box.w, box.h) if box else (np.nan,) * 4)
    return np.array(out)


def overlap(a: Array, b: Array) -> Array:
    """Intersection over union (N,); 0 where either is nan."""
    corner = np.maximum(a[:, :2], b[:, :2])
    size = np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]) - corner
    common = np.prod(np.maximum(size, 0.0), axis=1)
    either = np.prod(a[:, 2:], axis=1) + np.prod(b[:, 2:], axis=1) - common
    ratio: Array = np.nan_to_num(common / either)
    return ratio


@pytest.mark.parametrize(
    ("name", "least"), [("otb_human3", 0.3), ("otb_man", 0.6), ("tld_pedestrian2", 0.5)]
)
def test_people_in_real_clothes_are_followed(name: str, least: float) -> None:
    boxes = truth(name)
    rng = np.random.default_rng(31)
    success = []
    for _ in range(3):
        jitter = rng.uniform(-0.03, 0.03, 4) * np.tile(boxes[0, 2:], 2)
        visible = np.isfinite(boxes[:, 0])
        found = tracked(name, boxes[0] + jitter)
        overlaps = overlap(found, boxes)[visible]
        success.append(np.mean([(overlaps > t).mean() for t in np.linspace(0.0, 1.0, 21)]))
    assert np.median(success) >= least


def test_somebody_out_of_view_is_rarely_claimed() -> None:
    boxes = truth("tld_pedestrian2")
    found = tracked("tld_pedestrian2", boxes[0])
    absent = np.isnan(boxes[:, 0])
    assert np.isfinite(found[absent, 0]).mean() <= 0.25
