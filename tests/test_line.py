"""The cable between twin and host: line rate, chunks, wrong baud, unplugging, faults."""

import asyncio
from collections.abc import Awaitable, Callable
from math import inf

import numpy as np
import pytest

from followerd import clock
from followerd.errors import LinkLost, OpenError
from followerd.hw.stream import ByteStream, Received
from followerd.sim.faults import Fault
from followerd.sim.line import Line


class Beacon:
    """A twin that sends `burst` every `period` and echoes what it hears at once."""

    def __init__(self, burst: bytes = b"", period: float = inf, baud: int = 9600) -> None:
        self.baud = baud
        self.heard: list[Received] = []
        self.reboots: list[float] = []
        self._burst = burst
        self._period = period
        self._next = period
        self._echo = b""

    def receive(self, data: bytes, now: float) -> None:
        self.heard.append(Received(data, now))
        self._echo += data

    def step(self, now: float) -> bytes:
        out, self._echo = self._echo, b""
        while self._next <= now:
            out += self._burst
            self._next += self._period
        return out

    def wake_at(self) -> float:
        return self._next

    def reboot(self, now: float) -> None:
        self.reboots.append(now)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def on_line(line: Line, host: Callable[[], Awaitable[None]]) -> None:
    """Run `host` in virtual time while the line carries bytes."""

    async def main() -> None:
        async with asyncio.TaskGroup() as tasks:
            pump = tasks.create_task(line.run())
            await host()
            pump.cancel()

    clock.run_virtual(main())


async def read_for_ever(stream: ByteStream) -> None:
    while True:
        await stream.read()


@pytest.mark.parametrize(
    ("baud", "lengths"), [(38400, [61, 61, 28]), (115200, [62, 62, 26]), (9600, [15] * 10)]
)
def test_bursts_arrive_in_chunks_when_their_last_byte_has_crossed(
    baud: int, lengths: list[int]
) -> None:
    line = Line(Beacon(bytes(range(150)), 1.0, baud), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", baud)
        chunks = [await stream.read() for _ in lengths]
        assert b"".join(c.data for c in chunks) == bytes(range(150))
        assert [len(c.data) for c in chunks] == lengths
        crossed = 1.0 + np.cumsum(lengths) * 10 / baud
        assert [c.stamp for c in chunks] == pytest.approx(crossed, abs=1e-8)

    on_line(line, host)


def test_a_line_slower_than_its_twin_delivers_at_the_line_rate() -> None:
    line = Line(Beacon(bytes(120), 0.1), rng(), "robot")  # 1200 bytes/s into 960

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        count, start = 0, 0.1
        while count < 9600:
            received = await stream.read()
            count += len(received.data)
        assert received.stamp - start == pytest.approx(count / 960, abs=1e-6)

    on_line(line, host)


def test_what_the_host_writes_takes_its_line_time_too() -> None:
    twin = Beacon(baud=38400)
    line = Line(twin, rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 38400)
        stream.write(b"abcd")
        stream.write(b"ef")
        assert (await stream.read()).data == b"abcd"
        assert (await stream.read()).data == b"ef"
        byte = 10 / 38400
        assert [h.data for h in twin.heard] == [b"abcd", b"ef"]
        assert [h.stamp for h in twin.heard] == pytest.approx([4 * byte, 6 * byte], abs=1e-8)

    on_line(line, host)


def test_a_wrong_baud_garbles_both_directions_the_same_for_one_seed() -> None:
    def heard(seed: int) -> tuple[bytes, bytes]:
        twin = Beacon(baud=38400)
        line = Line(twin, rng(seed), "laser")
        answers: list[bytes] = []

        async def host() -> None:
            stream = await line.link.open("laser", 9600)
            stream.write(b"hello world")
            answers.append((await stream.read()).data)
            stream.set_baud(38400)
            stream.write(b"hello world")
            assert (await stream.read()).data == b"hello world"

        on_line(line, host)
        return twin.heard[0].data, answers[0]

    there, back = heard(seed=1)
    assert there != b"hello world"
    assert back not in (there, b"hello world")
    assert heard(seed=1) == (there, back)
    assert heard(seed=2) != (there, back)


def test_bytes_written_before_a_change_of_rate_still_leave_at_the_old_one() -> None:
    twin = Beacon(baud=9600)
    line = Line(twin, rng(), "laser")

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        stream.write(b"set 500000")
        await stream.drain()
        stream.set_baud(500000)
        await clock.sleep(0.1)
        assert twin.heard[0].data == b"set 500000"

    on_line(line, host)


def test_pulling_the_cable_is_noticed_at_once_and_the_link_can_be_opened_again() -> None:
    line = Line(Beacon(b"tick", 0.1), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        assert (await stream.read()).data == b"tick"
        asyncio.get_running_loop().call_at(0.15, line.unplug)
        with pytest.raises(LinkLost, match="base: unplugged"):
            await stream.read()
        assert clock.now() == pytest.approx(0.15)
        with pytest.raises(LinkLost):
            stream.write(b"x")
        with pytest.raises(OpenError, match="does not exist; plug the cable in"):
            await line.link.open("base", 9600)
        await clock.sleep(1.0)
        line.replug()
        again = await line.link.open("base", 9600)
        assert (await again.read()).stamp > 1.15  # what was sent meanwhile is lost

    on_line(line, host)


def test_a_link_is_exclusive_until_it_is_closed() -> None:
    line = Line(Beacon(), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        with pytest.raises(OpenError, match="busy"):
            await line.link.open("probe", 9600)
        stream.close()
        stream.close()
        await line.link.open("probe", 9600)

    on_line(line, host)


def test_a_port_that_is_written_faster_than_the_line_counts_as_lost() -> None:
    line = Line(Beacon(), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        for _ in range(81):
            stream.write(bytes(100))
        with pytest.raises(LinkLost, match="takes no more bytes"):
            stream.write(bytes(100))

    on_line(line, host)


def test_a_read_given_up_loses_no_bytes() -> None:
    line = Line(Beacon(b"tick", 0.1), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        assert await clock.within(0.05, stream.read()) is None
        assert (await stream.read()).data == b"tick"

    on_line(line, host)


def test_forgotten_input_is_gone() -> None:
    line = Line(Beacon(b"tick", 0.1), rng(), "robot")

    async def host() -> None:
        stream = await line.link.open("base", 9600)
        await clock.sleep(1.05)
        stream.discard_input()
        assert (await stream.read()).stamp > 1.05

    on_line(line, host)


def test_a_twin_that_never_gets_its_work_done_is_a_bug_not_a_hang() -> None:
    class Stuck(Beacon):
        def wake_at(self) -> float:
            return 0.0

    async def host() -> None:
        await clock.sleep(1.0)

    with pytest.raises(ExceptionGroup) as failed:
        on_line(Line(Stuck(), rng(), "robot"), host)
    assert failed.group_contains(RuntimeError, match="left work undone")


def test_a_silent_device_is_deaf_too_and_comes_back() -> None:
    twin = Beacon(b"tick", 0.1)
    line = Line(twin, rng(), "laser", faults=(Fault.parse("laser:off@1+2"),))

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        stamps: list[float] = []
        while clock.now() < 3.5:
            stamps.append((await stream.read()).stamp)
            stream.write(b"?" if 1 < clock.now() < 3 else b"")
        assert not [s for s in stamps if 1.01 < s < 2.99]
        assert [s for s in stamps if s > 3]
        assert not twin.heard

    on_line(line, host)


def test_a_disconnect_fault_pulls_the_cable_and_puts_it_back() -> None:
    line = Line(Beacon(b"tick", 0.1), rng(), "laser", faults=(Fault.parse("laser:disconnect@1+2"),))

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        with pytest.raises(LinkLost):
            await read_for_ever(stream)
        assert clock.now() == pytest.approx(1.0)
        await clock.sleep(1.5)
        with pytest.raises(OpenError):
            await line.link.open("laser", 9600)
        await clock.sleep(1.0)
        assert (await (await line.link.open("laser", 9600)).read()).data == b"tick"

    on_line(line, host)


def test_a_delayed_burst_crosses_later() -> None:
    line = Line(Beacon(b"t", 0.5), rng(), "laser", faults=(Fault.parse("laser:delay@0+9"),))

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        assert (await stream.read()).stamp == pytest.approx(0.8 + 10 / 9600)

    on_line(line, host)


def test_a_reboot_takes_the_power_and_gives_it_back() -> None:
    twin = Beacon(b"tick", 0.1)
    line = Line(twin, rng(), "laser", faults=(Fault.parse("laser:reboot@1s+2s"),))

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        stamps = [(await stream.read()).stamp for _ in range(20)]
        assert not [stamp for stamp in stamps if 1.01 < stamp < 2.99]
        assert twin.reboots == pytest.approx([1.0, 3.0])

    on_line(line, host)


def test_a_fault_can_come_while_the_line_runs() -> None:
    line = Line(Beacon(b"tick", 0.1), rng(), "laser")

    async def host() -> None:
        stream = await line.link.open("laser", 9600)
        await clock.sleep(2.0)
        line.inject(Fault.parse("laser:disconnect+1s", line.elapsed))
        with pytest.raises(LinkLost):
            await read_for_ever(stream)
        assert clock.now() == pytest.approx(2.0)
        with pytest.raises(OpenError):
            await line.link.open("laser", 9600)
        await clock.sleep(1.1)
        assert (await (await line.link.open("laser", 9600)).read()).data == b"tick"

    on_line(line, host)


def test_cables_pulled_twice_come_back_when_the_last_fault_is_over() -> None:
    both = (Fault.parse("laser:disconnect@1s+3s"), Fault.parse("laser:disconnect@2s+4s"))
    line = Line(Beacon(), rng(), "laser", faults=both)

    async def host() -> None:
        seen = []
        for _ in range(7):
            await clock.sleep(1.0)
            await clock.sleep(0)
            seen.append(line.plugged)
        assert seen == [False, False, False, False, False, True, True]

    on_line(line, host)
