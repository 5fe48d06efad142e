"""The LMS200 driver over a line that damages telegrams: no false stop, no wrong range."""

from collections import deque
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd import clock
from followerd.control.freshness import Freshness
from followerd.errors import LinkLost
from followerd.geometry import Pose2
from followerd.hw.lms200.protocol import Telegram
from followerd.hw.lms200.scans import ScanTelegram, Unit
from followerd.hw.lms200.session import CHUNK, Session
from followerd.hw.lms200.settings import Lms200Settings, stale_after, under_way
from followerd.hw.stream import Received
from followerd.messages import Measurement
from followerd.sim.twins.lms200 import Lms200Twin
from tests.lms200_bench import Rig, Round, rig

OFF = 0.15  # m; in a round room no range is that far off


class BadCable(Lms200Twin):
    """One telegram in a hundred leaves it damaged."""

    def __init__(self, seed: int, share: float = 0.01) -> None:
        super().__init__(Round(), np.random.default_rng(seed), Pose2())
        self.damaged = 0
        self.newest: deque[bool] = deque(maxlen=4)  # whether they were
        self._luck = np.random.default_rng(seed + 1)
        self._share = share

    def step(self, now: float) -> bytes:
        frame = super().step(now)
        if not frame:
            return frame
        self.newest.append(self._luck.random() < self._share)
        if not self.newest[-1]:
            return frame
        self.damaged += 1
        return self._hurt(bytearray(frame))

    def _hurt(self, frame: bytearray) -> bytes:
        luck = self._luck
        begin = int(luck.integers(len(frame)))
        end = min(len(frame), begin + int(luck.integers(1, 8)))
        match int(luck.integers(6)):
            case 0:
                frame[begin] ^= 1 << int(luck.integers(8))
            case 1:
                del frame[begin:end]
            case 2:
                frame[begin:begin] = frame[begin:end]
            case 3:
                frame[begin:end] = luck.bytes(end - begin)
            case 4:
                frame[begin:] = luck.bytes(len(frame) - begin)
            case _:
                del frame[begin:]
        return bytes(frame)


def scanned(device: Lms200Twin, seconds: float) -> Rig:
    async def story() -> Rig:
        async with rig(device) as it:
            await clock.sleep(seconds)
        return it

    return clock.run_virtual(story())


@pytest.mark.parametrize(
    ("seconds", "share"), [(10, 0.05), pytest.param(600, 0.01, marks=pytest.mark.slow)]
)
def test_damaged_telegrams_stop_nothing_and_say_nothing_wrong(seconds: float, share: float) -> None:
    device = BadCable(3, share)
    it = scanned(device, seconds)
    assert device.damaged == pytest.approx(37.5 * seconds * share, rel=0.5)
    assert not it.problems
    received = np.array([scan.received for scan in it.scans])
    stamps = np.array([scan.stamp for scan in it.scans])
    assert (received[1:] - stamps[:-1]).max() < stale_after(Lms200Settings())
    assert len(it.scans) > 37.5 * (seconds - 1.5) * (1 - share) - 10
    ranges = np.array([scan.ranges for scan in it.scans])
    assert np.abs(ranges[np.isfinite(ranges)] - 3.0).max() < OFF
    assert np.isnan(ranges).mean() < 1e-4


RS232 = {"baud": 38400, "resolution_deg": 1}  # where a robot stops for two scans that are missing


@pytest.mark.parametrize(
    ("seconds", "share"), [(20, 0.1), pytest.param(600, 0.02, marks=pytest.mark.slow)]
)
def test_on_a_slow_line_one_damaged_telegram_alone_is_no_stale_scan(
    seconds: float, share: float
) -> None:
    """One that is cut still shows where the next one begins (FAILSAFES F2, F7)."""
    settings = Lms200Settings.model_validate(RS232)
    device = BadCable(4, share)
    fresh = Freshness({"scan": stale_after(settings)}, ("scan",), {"scan": under_way(settings)})
    stale: list[str] = []

    def look() -> None:
        alone = not any(a and b for a, b in pairwise(device.newest))
        if fresh.newest["scan"] > 0.0 and fresh.stale(clock.now()) and alone:
            stale.append(f"{clock.now():.2f} s")

    def saw(scan: Measurement) -> None:
        look()
        fresh.saw("scan", scan.stamp, clock.now())

    def begun(_: str) -> None:
        look()
        if clock.now() - fresh.newest["scan"] > 0.6 * stale_after(settings):
            fresh.coming("scan")

    async def story() -> None:
        async with rig(device, **RS232) as it:
            vars(it)["sink"] = saw
            it.driver.on_begun = begun
            await clock.sleep(seconds)

    clock.run_virtual(story())
    assert device.damaged == pytest.approx(9.3 * seconds * share, rel=0.5)
    assert fresh.newest["scan"] > seconds - 1.0
    assert not stale


class Handed:
    """A stream of so many bytes and no more."""

    def __init__(self, wire: bytes) -> None:
        self._wire = wire

    async def read(self, at_least: int = 1) -> Received:
        chunk, self._wire = self._wire[:at_least], self._wire[at_least:]
        if len(chunk) < at_least:
            raise LinkLost("laser", "silent", "")
        return Received(chunk, 0.0)

    def write(self, data: bytes) -> None:
        raise AssertionError("nothing is asked")

    async def drain(self) -> None: ...

    def set_baud(self, baud: int) -> None: ...

    def discard_input(self) -> None: ...

    def close(self) -> None: ...


WORDS = np.arange(1000, 1181, dtype=np.uint16)
HEAD = 7  # bytes of a telegram that say what it is
damages = st.tuples(st.integers(1, 372), st.integers(0, 372), st.binary(max_size=40))


@given(damages)
def test_whatever_a_telegram_lost_the_beginning_of_the_next_one_is_told(
    damage: tuple[int, int, bytes],
) -> None:
    """At 38400 baud a robot that missed one stops unless it knows that another comes (F2, F7)."""
    first, lost, instead = damage
    whole = Telegram(0x80, ScanTelegram(WORDS, Unit.MM).to_payload()).to_bytes()
    following = Telegram(0x80, ScanTelegram(WORDS, Unit.CM).to_payload()).to_bytes()
    hurt = whole[:first] + instead + whole[first + lost :]
    told: list[bytes] = []

    async def listen() -> None:
        session = Session(Handed(hurt + following[: HEAD + CHUNK]), 38400)
        while True:
            await session.event(HEAD, told.append)

    with pytest.raises(LinkLost):
        clock.run_virtual(listen())
    assert following[:HEAD] in told
