"""A lost device is opened again with back-off and its loss and return are reported."""

import pytest

from followerd import clock
from followerd.errors import LinkLost, OpenError
from followerd.geometry import Pose2
from followerd.hw.interfaces import Sink
from followerd.messages import Fault, Measurement, Odometry, Twist
from followerd.runtime.supervisor import supervise


class Flaky:
    """Measures once per run, then loses its link; its first `dead` runs find nothing."""

    name = "base"

    def __init__(self, dead: int = 0) -> None:
        self.dead = dead
        self.runs: list[float] = []

    async def run(self, sink: Sink) -> None:
        self.runs.append(clock.now())
        if len(self.runs) <= self.dead:
            raise OpenError(self.name, "does not exist", "plug it in")
        await clock.sleep(1.0)
        sink(Odometry(clock.now(), clock.now(), Pose2(), Twist()))
        await clock.sleep(1.0)
        raise LinkLost(self.name, "unplugged")


class DeadAfterFirst(Flaky):
    """Works once, then cannot be opened any more."""

    async def run(self, sink: Sink) -> None:
        if self.runs:
            self.runs.append(clock.now())
            raise OpenError(self.name, "does not exist", "plug it in")
        await super().run(sink)


def watch(device: Flaky, seconds: float) -> tuple[list[Measurement], list[Fault]]:
    seen: list[Measurement] = []
    faults: list[Fault] = []
    clock.run_virtual(clock.within(seconds, supervise(device, seen.append, faults.append)))
    return seen, faults


def test_a_device_that_never_worked_is_an_error_not_a_retry() -> None:
    with pytest.raises(OpenError, match="base: does not exist; plug it in"):
        watch(Flaky(dead=1), 5.0)


def test_a_lost_device_comes_back_and_both_are_reported() -> None:
    device = Flaky()
    seen, faults = watch(device, 4.0)
    assert len(seen) == 2
    assert [fault.recovered for fault in faults] == [False, True]
    assert faults[0].detail == "base: unplugged"
    assert device.runs == pytest.approx([0.0, 2.25])


def test_retries_wait_longer_and_longer_up_to_a_bound() -> None:
    device = DeadAfterFirst()
    watch(device, 20.0)
    waits = [
        after - before for before, after in zip(device.runs[1:], device.runs[2:], strict=False)
    ]
    assert waits == pytest.approx([0.5] * len(waits))
    assert len(waits) > 10


def test_a_device_that_stays_away_is_said_once_and_reported_each_time(
    capsys: pytest.CaptureFixture[str],
) -> None:
    device = DeadAfterFirst()
    _, faults = watch(device, 20.0)
    assert capsys.readouterr().out.count("device lost") == 2  # how it was lost; how it is
    assert len(faults) > 10
    assert not any(fault.recovered for fault in faults)
