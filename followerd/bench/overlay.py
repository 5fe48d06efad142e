"""What a tracker thinks, drawn on its frame."""

import cv2
import numpy as np

from followerd.geometry import Array
from followerd.messages import Box, Pixels, TrackPhase, TrackState

WHITE, YELLOW, RED, BLUE = (255, 255, 255), (0, 230, 255), (0, 0, 255), (255, 120, 0)
DARK = (30, 30, 30)
LEAST_WIDTH = 480  # px; smaller frames are enlarged so that lines and text can be read


def draw(pixels: Pixels, track: TrackState | None, note: str = "") -> Pixels:
    """A BGR copy of the frame with candidates (white), particles (yellow) and the box (red).

    The box of an occluded person is blue; `note` is added to the line of text.
    """
    colour = pixels if pixels.ndim == 3 else cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    zoom = -(-LEAST_WIDTH // colour.shape[1])
    size = (colour.shape[1] * zoom, colour.shape[0] * zoom)
    canvas = np.asarray(cv2.resize(colour, size, interpolation=cv2.INTER_NEAREST), np.uint8)
    if track is None:
        _write(canvas, f"no track  {note}", WHITE)
        return canvas
    for candidate in track.candidates:
        _rectangle(canvas, candidate, zoom, WHITE, 1)
    if track.particles is not None and track.frame_id is not None:  # else in m, on the floor
        _scatter(canvas, track.particles[:, :2], zoom)
    shade = BLUE if track.phase is TrackPhase.OCCLUDED else RED
    if track.box is not None:
        _rectangle(canvas, track.box, zoom, shade, 2)
    _write(canvas, f"{track.phase.value} {track.confidence:.2f}  {note}", WHITE)
    return canvas


def _rectangle(
    canvas: Pixels, box: Box, zoom: int, colour: tuple[int, int, int], width: int
) -> None:
    low = (round(box.x * zoom), round(box.y * zoom))
    high = (round((box.x + box.w) * zoom), round((box.y + box.h) * zoom))
    cv2.rectangle(canvas, low, high, colour, width)


def _scatter(canvas: Pixels, particles: Array, zoom: int) -> None:
    finite = particles[np.isfinite(particles).all(axis=1)]
    height, width = canvas.shape[:2]
    for x, y in np.rint(finite * zoom).astype(int).tolist():
        if 0 <= x < width and 0 <= y < height:
            canvas[y : y + 2, x : x + 2] = YELLOW


def _write(canvas: Pixels, text: str, colour: tuple[int, int, int]) -> None:
    font, scale, height = cv2.FONT_HERSHEY_SIMPLEX, 0.45, canvas.shape[0]
    (width, _), _ = cv2.getTextSize(text, font, scale, 1)
    # dark ground instead of an outline: OpenCV 5 sets bold text wider
    cv2.rectangle(canvas, (0, height - 22), (width + 12, height), DARK, -1)
    cv2.putText(canvas, text, (6, height - 7), font, scale, colour, 1, cv2.LINE_AA)
