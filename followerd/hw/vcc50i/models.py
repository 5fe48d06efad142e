"""How far and how fast a head turns, in its own steps (0.1125°)."""

from dataclasses import dataclass

from followerd.hw.vcc50i.commands import ZOOM_RATIO, ZOOM_TELE


@dataclass(frozen=True, slots=True)
class Limits:
    """Ends of travel and top speeds; the camera says them, these are those of the manuals."""

    pan: tuple[int, int] = (-889, 889)  # steps, left and right end
    tilt: tuple[int, int] = (-267, 800)  # steps, lower and upper end
    pan_speed: int = 800  # steps/s
    tilt_speed: int = 622  # steps/s
    zoom_tele: int = ZOOM_TELE
    zoom_ratio: float = ZOOM_RATIO


SLOWEST = 8  # steps/s
MODELS = {
    "vc-c50i": Limits(),
    "vc-c4": Limits(tilt=(-267, 790), tilt_speed=662, zoom_ratio=16.0),  # ARIA's figures
}
