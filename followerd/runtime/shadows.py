"""Predictors that run beside the one that is listened to: compared and logged, heard by nobody."""

import asyncio
from collections import deque
from collections.abc import Sequence
from math import degrees

import numpy as np
import structlog

from followerd import clock
from followerd.estimation.foresight import Foresight, ForesightSettings
from followerd.estimation.predictors import Kind
from followerd.geometry import wrap_angle
from followerd.messages import Decision, Sight

WAITING = 8  # sights that may wait; older ones are left out
BUDGET = 0.01  # of the time, that they may take
KEPT = 100_000  # errors; a daemon runs for weeks

log = structlog.get_logger()


class Shadows:
    """Each foresees every next sight of the person, from the same sights, by its own generator."""

    def __init__(
        self, kinds: Sequence[Kind], settings: ForesightSettings, rng: np.random.Generator
    ) -> None:
        self._foresights = {
            kind: Foresight(settings.model_copy(update={"predictor": kind}), child)
            for kind, child in zip(kinds, rng.spawn(len(kinds)), strict=True)
        }
        self._errors: dict[Kind, deque[float]] = {kind: deque(maxlen=KEPT) for kind in kinds}  # deg
        self._waiting: deque[Sight | None] = deque()
        self._arrived = asyncio.Event()
        self._newest: Sight | None = None
        self._rests_until = 0.0  # s
        self.shed = 0  # sights left out for want of time

    def note(self, decision: Decision) -> None:
        """Take what the pipeline decided; that costs it next to nothing."""
        if decision.sight is self._newest:
            return
        self._newest = decision.sight
        if len(self._waiting) >= WAITING or clock.now() < self._rests_until:
            self.shed += 1
            return
        self._waiting.append(decision.sight)
        self._arrived.set()

    async def run(self) -> None:
        """Foresee for ever, when nothing else is to be done."""
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            while self._waiting:
                began = clock.now()
                self._take(self._waiting.popleft())
                took = clock.now() - began
                self._rests_until = began + took / BUDGET if took > 0.0 else began
                await clock.sleep(0.0)

    def figures(self) -> dict[str, object]:
        """How far off each foresaw the next sight, and how many sights were left out."""
        return {
            "shed": self.shed,
            **{
                kind: {
                    "sights": len(errors),
                    "error_mean_deg": round(float(np.mean(errors)), 3) if errors else None,
                    "error_p95_deg": round(float(np.percentile(errors, 95)), 3) if errors else None,
                }
                for kind, errors in self._errors.items()
            },
        }

    def _take(self, sight: Sight | None) -> None:
        if sight is None:
            for foresight in self._foresights.values():
                foresight.forget()
            return
        foreseen: dict[str, float] = {}
        for kind, foresight in self._foresights.items():
            pan = foresight.at(sight.stamp)
            if pan is not None:
                foreseen[kind] = round(degrees(pan), 2)
                self._errors[kind].append(abs(degrees(wrap_angle(pan - sight.pan))))
            foresight.see(sight.stamp, sight.pan)
        log.debug("foreseen", seen=round(degrees(sight.pan), 2), **foreseen)
