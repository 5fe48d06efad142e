"""Who may be taken for a lost person: soon whoever is near where they went, later who steps up.

Strangers have legs, too. For a few seconds the person is near; then whoever stands alone before the
laser is less and less likely to be them, until only somebody close asks to be followed.
"""

from dataclasses import dataclass
from math import dist, exp

import numpy as np
import numpy.typing as npt
from pydantic import Field

from followerd.geometry import Array
from followerd.perception.legs import LEG, SOLID, People
from followerd.settings import Settings

Mask = npt.NDArray[np.bool_]

TWO = 0.2  # m, a wider cluster is more than one leg
STRANGER = 0.3  # confidence that who stepped up is the enrolled person: shown, not followed


class ComebackSettings(Settings):
    """How long a lost person is expected where, and what it takes to be them."""

    soon_s: float = Field(3.0, ge=0, description="unseen less long, the person is near")
    near_m: float = Field(1.0, gt=0, description="of where they were seen last")
    pace_mps: float = Field(0.7, ge=0, description="by which that grows")
    stays_s: float = Field(0.15, ge=0, description="near there for so long is the person")
    gap_s: float = Field(0.3, ge=0, description="that somebody may not be seen in between")
    close_m: float = Field(1.0, gt=0, description="from the laser: who steps up is as close")
    farther_m: float = Field(2.0, ge=0, description="more than that, just after `soon_s`")
    fades_s: float = Field(8.0, gt=0, description="in which this more fades")
    front_deg: float = Field(60.0, gt=0, le=180, description="and not farther aside")
    memory_s: float = Field(
        0.5, gt=0, description="in which it is judged how well they stand there"
    )
    well: float = Field(0.5, gt=0, lt=1, description="share of that memory that takes")
    alone_m: float = Field(2.5, gt=0, description="another pair of legs this near makes it unsure")
    alone_leg_m: float = Field(2.0, gt=0, description="so does a leg")
    apart_m: float = Field(0.45, gt=0, description="candidates nearer to each other are one person")
    leap_m: float = Field(0.35, gt=0, description="farthest that one moves between two scans")


@dataclass(slots=True)
class Contender:
    """Somebody who may be the lost person."""

    position: Array  # (2,) m
    seen: float  # s, last
    since: float  # s
    is_known: bool  # somebody who was seen beside the person
    scans: int = 0
    standing: float = 0.0  # 0..1, share of late in which they stood there alone on two legs

    def follow(self, before: "Contender") -> None:
        """Take over the past of who is the same."""
        self.since = min(self.since, before.since)
        self.is_known |= before.is_known
        self.scans = max(self.scans, before.scans + 1)
        self.standing = max(self.standing, before.standing)


class Comeback:
    """The search for one lost person; positions are in the frame they are tracked in."""

    def __init__(self, position: Array, stamp: float, settings: ComebackSettings) -> None:
        self.settings = settings
        self._last = position
        self._lost = stamp  # s, when the person was seen last
        self._stamp = stamp
        self._contenders: list[Contender] = []

    @property
    def is_late(self) -> bool:
        """Whether whoever comes now is taken for stepping up alone, and may be anybody."""
        return self._stamp - self._lost >= self.settings.soon_s

    def step(
        self, people: People, position: Array, in_laser: Array, beam: float, known: Mask
    ) -> Array | None:
        """Where (2,) the person is back, if they are.

        `people` stand at `position` (M, 2), and at `in_laser` (M, 2) in `laser`, whose beams are
        `beam` rad apart; `known` (M,) are those who were seen beside the person.
        """
        s = self.settings
        dt, self._stamp = people.stamp - self._stamp, people.stamp
        share = 1.0 - exp(-dt / s.memory_s)
        alone = self._alone(people, in_laser, beam).tolist()
        away = np.hypot(in_laser[:, 0], in_laser[:, 1]).tolist()
        fade = exp(-max(self._stamp - self._lost - s.soon_s, 0.0) / s.fades_s)
        here = [Contender(at, people.stamp, people.stamp, bool(k))
                for at, k in zip(position, known, strict=True)]  # fmt: skip
        gone = []
        for before in self._contenders:
            same = [c for c in here if dist(c.position, before.position) < s.leap_m]
            for contender in same:
                contender.follow(before)
            if not same and people.stamp - before.seen < s.gap_s:
                before.standing -= share * before.standing
                gone.append(before)
        for contender, is_alone, distance in zip(here, alone, away, strict=True):
            reach = s.close_m + (0.0 if contender.is_known else s.farther_m * fade)
            contender.standing += share * ((is_alone and distance < reach) - contender.standing)
        self._contenders = here + gone
        return self._chosen(here)

    def _chosen(self, here: list[Contender]) -> Array | None:
        s = self.settings
        unseen = self._stamp - self._lost
        if unseen < s.soon_s:
            back = [c for c in here if self._is_near(c, s.near_m + s.pace_mps * unseen)]
            best = min(back, key=lambda c: dist(c.position, self._last), default=None)
        else:
            back = [c for c in here if c.standing > s.well]
            best = max(back, key=lambda c: c.standing, default=None)
        return None if best is None else best.position

    def _is_near(self, one: Contender, reach: float) -> bool:
        stayed = one.scans >= 2 and self._stamp - one.since > self.settings.stays_s
        return stayed and not one.is_known and dist(one.position, self._last) < reach

    def _alone(self, people: People, at: Array, beam: float) -> Mask:
        """Which (M,) stand in front on two legs, with nobody else around."""
        s = self.settings
        away = np.hypot(at[:, 0], at[:, 1])
        legs = np.where(people.both, 2, 1)
        solid = people.count > SOLID * legs * LEG / (np.maximum(away, LEG) * beam)
        somebody = solid & (away < np.where(people.both, s.alone_m, s.alone_leg_m))
        apart = at[:, None] - at
        other = np.einsum("ijk,ijk->ij", apart, apart) > s.apart_m**2
        front = np.abs(np.arctan2(at[:, 1], at[:, 0])) < np.radians(s.front_deg)
        alone: Mask = front & solid & (people.both | (people.width > TWO))
        alone &= ~(other & somebody).any(axis=1)
        return alone
