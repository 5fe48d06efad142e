"""The LMS200 driver over a line that damages telegrams: no false stop, no wrong range."""

import numpy as np
import pytest

from followerd import clock
from followerd.geometry import Pose2
from followerd.hw.lms200.settings import Lms200Settings, stale_after
from followerd.sim.twins.lms200 import Lms200Twin
from tests.lms200_bench import Rig, Round, rig

OFF = 0.15  # m; in a round room no range is that far off


class BadCable(Lms200Twin):
    """One telegram in a hundred leaves it damaged."""

    def __init__(self, seed: int, share: float = 0.01) -> None:
        super().__init__(Round(), np.random.default_rng(seed), Pose2())
        self.damaged = 0
        self._luck = np.random.default_rng(seed + 1)
        self._share = share

    def step(self, now: float) -> bytes:
        frame = super().step(now)
        if not frame or self._luck.random() >= self._share:
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
