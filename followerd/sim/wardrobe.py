"""Who wears what: outfits drawn from the scenario, some of them close to the target's."""

from collections.abc import Sequence
from colorsys import hsv_to_rgb, rgb_to_hsv

import numpy as np

from followerd.sim.people import Pedestrian
from followerd.sim.scenarios import Cloth, Outfit, Person

HUE_SHIFT = (0.03, 0.07)  # of the full circle
DIMMER = (0.65, 0.85)  # ratio of brightness and saturation


def dress(people: Sequence[Person], rng: np.random.Generator) -> list[Pedestrian]:
    """The persons with their clothes on, in the scenario's order."""
    outfits: list[Outfit | None] = [
        person.outfits[int(rng.integers(len(person.outfits)))] if person.outfits else None
        for person in people
    ]
    worn = next((o for o, p in zip(outfits, people, strict=True) if p.target), None)
    dressed = []
    for person, outfit, child in zip(people, outfits, rng.spawn(len(people)), strict=True):
        if outfit is None:
            assert worn is not None, "Scenario checks that like_target has a dressed target"
            outfit = similar(worn, rng)
        dressed.append(Pedestrian(person, outfit, child))
    return dressed


def similar(outfit: Outfit, rng: np.random.Generator) -> Outfit:
    """An outfit of the same kind whose colours are a little off."""
    return outfit.model_copy(
        update={"upper": _off(outfit.upper, rng), "lower": _off(outfit.lower, rng)}
    )


def _off(cloth: Cloth, rng: np.random.Generator) -> Cloth:
    side = 1 if rng.random() < 0.5 else -1
    turn, dim, fade = side * rng.uniform(*HUE_SHIFT), rng.uniform(*DIMMER), rng.uniform(*DIMMER)

    def shifted(colour: str) -> str:
        h, s, v = rgb_to_hsv(*(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)))
        rgb = hsv_to_rgb((h + turn) % 1.0, s * fade, v * dim)
        return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)

    return cloth.model_copy(
        update={"colour": shifted(cloth.colour), "second": shifted(cloth.second)}
    )
