"""A person as parts to draw: head, neck, torso, arms, and two legs that walk."""

from math import atan2, cos, hypot, sin, sqrt, tau

import numpy as np

from followerd.sim import textures
from followerd.sim.canvas import Part, Point3, Texture
from followerd.sim.people import HIP, Motion, Pedestrian, lift, swing
from followerd.sim.scenarios import Cloth

SKIN_HEAT, CLOTH_HEAT, SHOE_HEAT = 205, 150, 110


class Figure:
    """Draws one pedestrian; lengths are shares of the body height."""

    def __init__(self, person: Pedestrian, rng: np.random.Generator) -> None:
        self._person = person
        outfit = person.outfit
        skin = Cloth(colour=outfit.skin)
        self._head = [Texture(view, SKIN_HEAT) for view in textures.head(outfit, rng)]
        self._torso = [Texture(view, CLOTH_HEAT) for view in textures.torso(outfit.upper, rng)]
        self._neck = Texture(textures.limb(skin, 1.0, rng), SKIN_HEAT)
        self._upper_arm = Texture(textures.limb(outfit.upper, 0.85, rng), CLOTH_HEAT)
        self._forearm = Texture(
            textures.limb(outfit.upper, 0.75, rng, outfit.skin, 0.33), CLOTH_HEAT
        )
        self._thigh = Texture(textures.limb(outfit.lower, 0.8, rng), CLOTH_HEAT)
        self._shank = Texture(textures.limb(outfit.lower, 0.8, rng), CLOTH_HEAT)
        self._shoe = Texture(textures.limb(Cloth(colour=outfit.shoes), 0.9, rng), SHOE_HEAT)

    def parts(self, motion: Motion, eye_x: float, eye_y: float) -> list[Part]:
        """The parts in the world, seen from (eye_x, eye_y)."""
        h = self._person.height
        body = _Body(motion, h)
        towards = atan2(motion.y - eye_y, motion.x - eye_x)
        turn = (motion.heading - towards) % tau  # 0 = seen from behind
        view = round(turn / tau * textures.VIEWS) % textures.VIEWS
        breadth = h * hypot(0.235 * cos(turn), 0.155 * sin(turn))
        ahead = 0.01 * h
        parts = [
            Part(
                body.at(ahead, 0, 0.995),
                body.at(ahead, 0, 0.87),
                0.098 * h,
                0.0,
                self._head[view],
                0.02,
            ),
            Part(body.at(0, 0, 0.90), body.at(0, 0, 0.82), 0.07 * h, 0.0, self._neck),
            Part(body.at(0, 0, 0.845), body.at(0, 0, 0.46), breadth, 0.0, self._torso[view], 0.12),
        ]
        for side in (1, -1):
            parts += self._leg(body, side)
            parts += self._arm(body, side)
        return parts

    def _leg(self, body: "_Body", side: int) -> list[Part]:
        h = body.height
        foot, up = body.feet[side]
        hip = 0.0, side * HIP, body.hip / h
        ankle = foot, side * HIP, (0.045 * h + up) / h
        # the knee bends forward as far as the two bones need
        span = hypot(foot, body.hip - 0.045 * h - up)
        bend = sqrt(max(0.0, (0.244 * h) ** 2 - (0.5 * span) ** 2))
        knee = 0.5 * foot + bend, side * HIP, 0.5 * (hip[2] + ankle[2])
        thigh_top, knee_at, ankle_at = body.at(*hip), body.at(*knee), body.at(*ankle)
        heel = body.at(foot - 0.025 * h, side * HIP, (0.022 * h + up) / h)
        toe = body.at(foot + 0.085 * h, side * HIP * 1.15, (0.016 * h + up) / h)
        return [
            Part(heel, toe, 0.055 * h, 0.02 * h, self._shoe, nearer=0.12),
            Part(knee_at, ankle_at, 0.086 * h, 0.03 * h, self._shank, nearer=0.01),
            Part(thigh_top, knee_at, 0.112 * h, 0.02 * h, self._thigh, nearer=0.02),
        ]

    def _arm(self, body: "_Body", side: int) -> list[Part]:
        h = body.height
        angle = -0.75 * body.feet[side][0] / (0.5 * h)  # arms swing against the legs
        shoulder = 0.0, side * 0.108 * h, 0.79
        elbow = 0.17 * h * sin(angle), side * 0.13 * h, 0.79 - 0.17 * cos(angle)
        bent = angle + 0.25
        hand = elbow[0] + 0.21 * h * sin(bent), side * 0.125 * h, elbow[2] - 0.21 * cos(bent)
        return [
            Part(body.at(*shoulder), body.at(*elbow), 0.066 * h, 0.025 * h, self._upper_arm),
            Part(body.at(*elbow), body.at(*hand), 0.054 * h, 0.02 * h, self._forearm),
        ]


class _Body:
    """Where points of the body are: metres ahead and to the left, heights as shares."""

    def __init__(self, motion: Motion, height: float) -> None:
        self.height = height
        self._motion = motion
        self._c, self._s = cos(motion.heading), sin(motion.heading)
        self.feet = {side: (swing(motion, side), lift(motion, side)) for side in (1, -1)}
        reach = max(abs(foot) for foot, _ in self.feet.values())
        self.hip = min(0.53 * height, 0.045 * height + sqrt((0.488 * height) ** 2 - reach**2))
        self._sink = 0.53 * height - self.hip  # the body goes down a little at each step

    def at(self, ahead: float, left: float, share: float) -> Point3:
        """A point of the world; above the hip it goes up and down with the steps."""
        z = share * self.height
        if share > 0.6:
            z -= self._sink
        return (
            self._motion.x + self._c * ahead - self._s * left,
            self._motion.y + self._s * ahead + self._c * left,
            z,
        )
