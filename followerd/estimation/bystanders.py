"""Everybody and everything else on legs around the followed person, so as not to be taken for them.

A table's legs are as good as people who pass: what has been seen elsewhere for a while is not the
person, even when it comes near or stands before them.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]


class BystanderSettings(Settings):
    """When something is somebody else."""

    apart_m: float = Field(0.7, gt=0, description="legs farther from the person are not theirs")
    around_m: float = Field(3.0, gt=0, description="farther from the person nobody matters")
    reach_m: float = Field(0.4, gt=0, description="from somebody's middle to their legs")
    scans: int = Field(3, ge=1, description="beyond the person's reach make somebody known")
    forgotten_s: float = Field(0.5, ge=0, description="unseen so long is gone")
    trust: float = Field(0.01, gt=0, le=1, description="left in a leg of somebody known")
    position_gain: float = Field(0.6, gt=0, le=1)
    velocity_gain: float = Field(0.25, ge=0, le=1)
    fastest_mps: float = Field(2.0, gt=0, description="nobody walks faster")


@dataclass(slots=True)
class Bystander:
    """One of them."""

    position: Array  # (2,) m
    velocity: Array  # (2,) m/s
    seen: float  # s, last
    scans: int = 1  # in which their legs could not be the person's


class Bystanders:
    """All of them; positions in the frame the person is tracked in."""

    def __init__(self, settings: BystanderSettings) -> None:
        self.settings = settings
        self.known: list[Bystander] = []
        self._stamp = 0.0
        self._free: Mask = np.empty(0, np.bool_)

    def step(self, legs: Array, person: Array, stamp: float) -> Array:
        """Trust (K,) in legs (K, 2) being the person's, who is expected at `person` (2,)."""
        s = self.settings
        dt, self._stamp = stamp - self._stamp, stamp
        to_person = np.hypot(*(legs - person).T)
        trust = np.ones(len(legs))
        self._free = np.ones(len(legs), np.bool_)
        for one in self.known:
            one.position = one.position + dt * one.velocity
            away = np.hypot(*(legs - one.position).T)
            own = (away < s.reach_m) & (away < to_person) & self._free
            if own.any():
                off = legs[own].mean(axis=0) - one.position
                one.position = one.position + s.position_gain * off
                one.velocity = one.velocity + s.velocity_gain / max(dt, 0.01) * off
                one.velocity /= max(1.0, np.hypot(*one.velocity) / s.fastest_mps)
                one.seen = stamp
                one.scans += bool((to_person[own] > s.reach_m).all())
                self._free &= ~own
                if one.scans > s.scans:
                    trust[own] = s.trust
        self.known = [one for one in self.known if stamp - one.seen < s.forgotten_s]
        return trust

    def learn(self, legs: Array, person: Array) -> None:
        """Take legs (K, 2) of the same scan that are nobody's for somebody new.

        `person` (2,) is where the person was just seen.
        """
        s = self.settings
        away = np.hypot(*(legs - person).T)
        for leg in legs[self._free & (away > s.apart_m) & (away < s.around_m)]:
            if all(np.hypot(*(leg - one.position)) > s.reach_m for one in self.known):
                self.known.append(Bystander(leg, np.zeros(2), self._stamp))
