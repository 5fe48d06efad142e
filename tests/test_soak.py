"""Ten virtual minutes behind a person with one telegram in a hundred corrupted."""

import sys
from collections import deque
from itertools import pairwise
from math import hypot
from typing import Any

import numpy as np
import pytest

from followerd import app, clock
from followerd.bench.closed_loop import simulate
from followerd.config import load
from followerd.control.transitions import ARMED
from followerd.geometry import Array, wrap_angle
from followerd.hw.lms200.protocol import Telegram, TelegramDecoder
from followerd.hw.lms200.scans import ScanTelegram, ranges_of
from followerd.hw.lms200.telegrams import BadTelegram
from followerd.messages import Decision, Measurement, Odometry, Scan
from followerd.runtime import logs
from followerd.runtime.daemon import Daemon
from followerd.sim.faults import Damage, Fault, FaultKind, Pieces
from followerd.sim.twins.lms200 import Lms200Twin
from followerd.sim.twins.p2os import P2osTwin

SHARE = 0.01  # of telegrams
KINDS = (FaultKind.FLIP, FaultKind.DROP, FaultKind.GARBAGE)
CAMERA = {"camera.rate_hz": 8, "camera.width": 96, "camera.height": 72}
RS232 = {"laser.baud": 38400, "laser.resolution_deg": 1}  # where a scan missed is felt most
RS422 = {"laser.baud": 500000, "laser.resolution_deg": 0.5}
LONG = 300  # bytes, more than any telegram but a scan
DEVICE_STREAMS = ("base", "laser", "odometry", "scan")
MOVED = (0.06, 0.08)  # m, rad that a robot can move while its packet is under way


class Witness:
    """Compares what the daemon is told with what the twins meant to say."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.wrong: list[str] = []
        self.stops: list[str] = []  # because of a device, with less than two telegrams lost
        self.scans = self.odometry = self.hurt = 0
        self._recent: deque[bool] = deque(maxlen=4)  # whether the newest scans were hurt
        self._sent: deque[Array] = deque(maxlen=6)
        self._base: P2osTwin | None = None
        self._follows = False
        laser_step, base_step = Lms200Twin.step, P2osTwin.step

        def scan(twin: Lms200Twin, now: float) -> bytes:
            burst = laser_step(twin, now)
            self._remember(burst)
            return burst

        def status(twin: P2osTwin, now: float) -> bytes:
            self._base = twin
            return base_step(twin, now)

        apply = Damage.apply

        def damage(line: Damage, burst: bytes, elapsed: float) -> Pieces:
            pieces = apply(line, burst, elapsed)
            is_hurt = b"".join(piece for _, piece in pieces) != burst
            self.hurt += is_hurt
            if len(burst) > LONG:
                self._recent.append(is_hurt)
            return pieces

        monkeypatch.setattr(Damage, "apply", damage)
        monkeypatch.setattr(Lms200Twin, "step", scan)
        monkeypatch.setattr(P2osTwin, "step", status)

    def attach(self, daemon: Daemon) -> None:
        """Look at a daemon."""
        daemon.measurement_watchers.append(self._check)
        daemon.decision_watchers.append(self._judge)

    def _remember(self, burst: bytes) -> None:
        for event in TelegramDecoder().feed(burst):
            if isinstance(event, Telegram):
                try:
                    meant = ScanTelegram.from_payload(event.payload)
                except BadTelegram:
                    continue
                self._sent.append(ranges_of(meant.words, 0, meant.unit))

    def _check(self, measured: Measurement) -> None:
        if isinstance(measured, Scan):
            self.scans += 1
            if not any(_agrees(measured.ranges, meant) for meant in self._sent):
                self.wrong.append(f"{clock.now():.2f} s: a scan that was not sent")
        elif isinstance(measured, Odometry) and self._base is not None:
            self.odometry += 1
            chassis, pose = self._base.chassis, measured.pose
            moved = hypot(pose.x - chassis.x, pose.y - chassis.y)
            turned = abs(wrap_angle(pose.theta - chassis.heading))
            if moved > MOVED[0] or turned > MOVED[1]:
                self.wrong.append(f"{clock.now():.2f} s: {moved:.3f} m, {turned:.3f} rad off")

    def _judge(self, decision: Decision) -> None:
        if decision.mode in ARMED and decision.mode.value != "ready":
            self._follows = True
        if self._follows:
            reasons = [r for r in decision.reasons if r.full_stop and r.device in DEVICE_STREAMS]
            if not any(a and b for a, b in pairwise(self._recent)):
                self.stops += [f"{decision.stamp:.2f} s: {reason}" for reason in reasons]


def _agrees(ranges: Array, meant: Array) -> bool:
    """Whether every range is one that was sent; what was left out is no lie."""
    seen = np.isfinite(ranges)
    return ranges.size == meant.size and bool(np.array_equal(ranges[seen], meant[seen]))


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("laser", "minutes", "rate"), [(RS232, 10, 9.3), (RS422, 2, 37.0)])
def test_one_corrupted_telegram_in_a_hundred_neither_stops_the_robot_nor_misleads_it(
    laser: dict[str, float], minutes: int, rate: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two scans lost in a row are no false stop: F2 asks for it where scans come slowly."""
    logs.configure("error")
    witness = Witness(monkeypatch)
    config = load("hpf-sim", {"seed": 4, **laser, **CAMERA})
    faults = [
        Fault(device, kind, 0.0, 1e6, SHARE / len(KINDS))
        for device in ("robot", "laser")
        for kind in KINDS
    ]
    seconds = 60.0 * minutes
    figures: dict[str, Any] = simulate(
        config, seconds, witness.attach, world=app.rig(config, faults)
    )
    sys.stdout.write(
        f"{minutes} min: {witness.scans} scans, {witness.odometry} status packets,"
        f" {witness.hurt} telegrams hurt; false stops {len(witness.stops)},"
        f" wrong {len(witness.wrong)}\n"
    )
    assert not witness.wrong, witness.wrong[:5]
    assert not witness.stops, witness.stops[:5]
    assert witness.hurt > 0.008 * (witness.scans + witness.odometry)
    assert witness.scans > 0.95 * seconds * rate
    assert figures["mode_s"]["following"] > 0.95 * seconds
    assert figures["follow"]["collision_count"] == 0
