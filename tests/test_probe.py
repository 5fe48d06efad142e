"""`followerd probe`: whatever is plugged in is named, and nothing moves for it."""

import asyncio
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from followerd import clock
from followerd.__main__ import call
from followerd.hw.lms200.probe import LaserFound
from followerd.hw.lms200.protocol import Telegram, TelegramDecoder
from followerd.hw.lms200.telegrams import BAUD_CODES, Command, Mode, request
from followerd.hw.p2os.commands import BAUDS, Cmd, Request, command
from followerd.hw.p2os.probe import RobotFound
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.probe import LIMIT, SWEEPS, Found, Unidentified, probe
from followerd.hw.serial import open_link
from followerd.hw.stream import ByteStream
from followerd.hw.vcc50i.commands import STATUS
from followerd.hw.vcc50i.commands import Cmd as HeadCmd
from followerd.hw.vcc50i.probe import HeadFound
from followerd.hw.vcc50i.protocol import FROM_HOST, FrameDecoder
from followerd.pytest_plugin import Simulation
from followerd.sim.interfaces import Twin
from followerd.sim.line import Line
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests import lms200_bench
from tests.p2os_bench import STOPPING, bench, story
from tests.test_p2os_cold_start import STATES, leave_behind

HARMLESS = STOPPING | {(Cmd.PULSE, None), (Cmd.OPEN, None), (Cmd.CLOSE, None)}
ENDS = LIMIT + 0.2  # s: a session is closed after the limit, too


class Told(list[str]):
    """What probing said meanwhile, and how long it took."""

    seconds = 0.0


class Eavesdropper:
    """A twin that keeps what it hears, at whatever rate it is sent."""

    def __init__(self, twin: Twin) -> None:
        self.twin = twin
        self.heard = b""

    def __getattr__(self, name: str) -> Any:
        return getattr(self.twin, name)

    def receive(self, data: bytes, now: float) -> None:
        self.heard += data
        self.twin.receive(data, now)


class Silence:
    """Nobody; says `says` once, after a second."""

    baud = 9600

    def __init__(self, says: bytes = b"") -> None:
        self.heard = b""
        self._says = says
        self._at = 0.1 if says else inf

    def receive(self, data: bytes, now: float) -> None:
        self.heard += data

    def step(self, now: float) -> bytes:
        says, self._says, self._at = self._says, b"", inf
        return says

    def wake_at(self) -> float:
        return self._at

    def reboot(self, now: float) -> None:
        """It forgets nothing."""


async def probed(line: Line) -> tuple[Found | Unidentified, Told]:
    """What probing a line says."""
    told, begun = Told(), clock.now()
    try:
        found: Found | Unidentified = await probe(line.link, told.append)
    except Unidentified as reason:
        found = reason
    told.seconds = clock.now() - begun
    assert told.seconds < ENDS
    return found, told


def probe_of(twin: Twin, settle: float = 0.0) -> tuple[Found | Unidentified, Told]:
    """What probing a twin says, `settle` seconds after it was switched on."""

    async def main() -> tuple[Found | Unidentified, Told]:
        line = Line(twin, np.random.default_rng(1), "port")
        pump = asyncio.create_task(line.run())
        await clock.sleep(settle)
        answer = await probed(line)
        pump.cancel()
        return answer

    return clock.run_virtual(main())


@pytest.mark.parametrize("state", STATES)
def test_a_base_in_any_state_tells_its_name_and_does_not_move(state: str) -> None:
    async def told() -> None:
        async with bench(**STATES[state].options) as b:
            await leave_behind(b, STATES[state])
            is_held, rolled, before = b.twin.is_held, b.body.rolled, len(b.twin.heard)
            assert is_held == ("watchdog" in state)
            found, said = await probed(b.line)
            assert isinstance(found, RobotFound), (str(found), said)
            assert found.identity.name == "followerd_twin"
            assert found.volts == pytest.approx(12.6, abs=0.6)
            assert found.stop_button == (state == "STOP pressed")
            if not state.startswith("driving"):
                assert b.body.rolled == rolled  # 0 mm
            assert b.body.is_still
            assert not b.twin.is_connected, "the session was left open"
            assert set(b.twin.heard[before:]) <= HARMLESS
            rolled = b.body.rolled
            await clock.sleep(3.0)
            assert b.body.rolled == rolled

    story(told)


STATUS_OF_A_LASER = request(Command.STATUS).to_bytes()
STREAM = request(Command.MODE, bytes((Mode.STREAM,)))


def laser(baud: int = 9600, streams: bool = False, **options: Any) -> Eavesdropper:
    """A laser left at a rate, perhaps streaming."""
    twin = lms200_bench.twin(**options)
    if baud != 9600:
        twin.receive(request(Command.MODE, bytes((BAUD_CODES[baud],))).to_bytes(), 0.0)
        for at in (0.0, 0.03, 0.06, 0.1):
            twin.step(at)
    if streams:
        twin.receive(STREAM.to_bytes(), 0.1)
    return Eavesdropper(twin)


@pytest.mark.parametrize("streams", [False, True])
@pytest.mark.parametrize("baud", BAUD_CODES)
def test_a_laser_is_named_at_any_rate_streaming_or_not(baud: int, streams: bool) -> None:
    found, said = probe_of(laser(baud, streams), settle=1.0)
    assert isinstance(found, LaserFound), (str(found), said)
    assert (found.kind, found.baud, found.address) == ("LMS200;301061;V02.10", baud, 0)
    assert found.was_streaming == streams
    assert str(found) == (
        f"laser LMS200;301061;V02.10, 180°/0.5°, mm, {baud} baud, address 0, window 100 % clear"
        + (", was streaming and was stopped" if streams else "")
    )
    assert said.seconds < 8.0


def test_a_streaming_laser_is_told_nothing_but_to_stop_and_to_answer() -> None:
    twin = laser(38400, streams=True)
    twin.heard = b""
    probe_of(twin, settle=1.0)
    asked = TelegramDecoder(from_device=False).feed(twin.heard)
    assert [event.payload for event in asked if isinstance(event, Telegram)] == [
        bytes((Command.MODE, Mode.ON_REQUEST)),
        bytes((Command.TYPE,)),
        bytes((Command.STATUS,)),
        bytes((Command.ERRORS,)),
    ]


def test_a_laser_with_another_address_and_a_dirty_window_says_so() -> None:
    found, _ = probe_of(laser(address=1, polluted=True))
    assert "address 1, window 60 % clear; it reports a dirty window" in str(found)
    assert "clean its window" in str(found)


def test_a_laser_that_boots_is_listened_for_and_then_given_up_with_a_word() -> None:
    found, said = probe_of(lms200_bench.twin(boot_time=9.0))
    assert isinstance(found, LaserFound)
    assert said[-1] == "a laser has booted at 9600 baud"
    found, said = probe_of(lms200_bench.twin(boot_time=40.0))
    assert isinstance(found, Unidentified)
    assert "nothing answers within 12 s" in str(found)
    assert "a laser that still boots (up to 60 s): then try again" in str(found)
    assert "boots for up to 60 s: listening for" in said[-1]


@pytest.mark.parametrize(("is_on", "is_local"), [(True, True), (True, False), (False, True)])
def test_a_camera_head_is_named_and_does_not_turn(is_on: bool, is_local: bool) -> None:
    rng = np.random.default_rng(1)
    twin = Vcc50iTwin(rng, knows_home=True, is_on=is_on, is_local=is_local)
    found, _ = probe_of(twin)
    assert isinstance(found, HeadFound)
    assert str(found).startswith("Canon pan-tilt head ")
    assert ("switched off" in str(found)) == (not is_on)
    assert {asked.command for asked in twin.obeyed} <= {HeadCmd.STATUS, HeadCmd.NAME}


def test_nobody_there_is_said_within_the_limit() -> None:
    found, said = probe_of(Silence())
    assert str(found).startswith("nothing answers within 12 s: no device, no power, ")
    assert said.seconds == pytest.approx(LIMIT, abs=0.1)
    assert said[0] == "asking at 9600, 38400, 19200, 115200, 57600, 500000 baud"
    assert said[1] == "asking once more at all rates"


def test_another_device_that_sends_text_is_asked_nothing() -> None:
    twin = Silence(b"$GPRMC,123519,A,4807.038,N,01131.000,E*6A\r\n")
    found, _ = probe_of(twin)
    assert "another device sends text at 9600 baud ('$GPRMC,1" in str(found)
    assert twin.heard == b""


def test_noise_at_every_rate_is_said_and_ends_in_time() -> None:
    class Noise(Silence):
        rng = np.random.default_rng(3)

        def step(self, now: float) -> bytes:
            self._at = now + 0.04
            return self.rng.bytes(30)

    found, said = probe_of(Noise(b"noise"))
    assert "something talks, at no rate as " in str(found)
    assert said.seconds <= LIMIT + 0.1


def test_an_unplugged_port_is_one_clear_line() -> None:
    async def main() -> str:
        line = Line(Silence(), np.random.default_rng(1), "port")
        pump = asyncio.create_task(line.run())
        asyncio.get_running_loop().call_later(1.0, line.unplug)
        found, _ = await probed(line)
        pump.cancel()
        return str(found)

    assert clock.run_virtual(main()) == "unplugged"


class Wiretap:
    """A link to `line` that keeps what is sent, whatever becomes of it on the line."""

    def __init__(self, line: Line) -> None:
        self.name = line.link.name
        self.sent: list[bytes] = []
        self._line = line

    async def open(self, device: str, baud: int) -> ByteStream:
        stream = await self._line.link.open(device, baud)
        write = stream.write

        def written(data: bytes) -> None:
            self.sent.append(data)
            write(data)

        monkey: Any = stream
        monkey.write = written
        return stream


def said_to_nobody() -> bytes:
    """All that is sent to a silent port."""

    async def main() -> bytes:
        line = Line(Silence(), np.random.default_rng(1), "port")
        pump, tap = asyncio.create_task(line.run()), Wiretap(line)
        with pytest.raises(Unidentified):
            await probe(tap, lambda _: None)
        pump.cancel()
        return b"".join(tap.sent)

    return clock.run_virtual(main())


def test_no_device_takes_what_another_is_asked_for_its_own() -> None:
    """From whatever byte on it hears, and whatever it makes of a pause; see hw.probe."""
    sent = said_to_nobody()
    mine = STOPPING | {(Cmd.PULSE, None), (Cmd.CLOSE, None)}
    for start in range(len(sent)):
        packets = PacketDecoder()
        for packet in (*packets.feed(sent[start:]), *packets.settle()):
            order = Request.parse(packet.payload)
            assert (order.number, order.argument) in mine
        telegrams = TelegramDecoder(from_device=False)
        for event in (*telegrams.feed(sent[start:]), *telegrams.give_up()):
            assert not isinstance(event, Telegram) or event.payload == bytes((Command.STATUS,))
        for frame in FrameDecoder(FROM_HOST).feed(sent[start:]):
            assert frame.to_bytes() == STATUS.to_bytes()


def test_each_device_is_asked_in_its_own_words_and_stopped_before_a_sync() -> None:
    sent = said_to_nobody()
    orders = [Request.parse(packet.payload) for packet in PacketDecoder().feed(sent)]
    knock = [Cmd.STOP, Cmd.VEL, Cmd.RVEL, Cmd.CLOSE, Cmd.STOP, Cmd.VEL, Cmd.RVEL, Cmd.PULSE]
    assert [order.number for order in orders] == knock * len(BAUDS) * SWEEPS
    first = sent.index(STATUS_OF_A_LASER)
    assert len(PacketDecoder().feed(sent[:first])) == len(knock) * len(BAUDS)  # at all rates
    asked = TelegramDecoder(from_device=False).feed(sent)
    assert sum(isinstance(event, Telegram) for event in asked) == len(BAUD_CODES) * SWEEPS
    assert len(FrameDecoder(FROM_HOST).feed(sent)) == SWEEPS


async def leave_driving(link: str) -> None:
    """A client that drives the base and is then killed: nobody takes leave of it."""
    stream = await open_link(link).open("base", 9600)
    for order in (command(0), command(1), command(2), command(1), command(Cmd.ENABLE, 1)):
        stream.write(order)
        await clock.sleep(0.1)
    stream.write(command(Cmd.VEL, 300) + command(Cmd.RVEL, 20))
    await clock.sleep(0.5)
    stream.close()


@pytest.mark.slow
def test_probing_real_ports_beside_a_base_stopped_by_its_watchdog_moves_it_by_0_mm(
    simulation: Callable[[], Simulation], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    twins, config = simulation(), tmp_path / "found.yaml"
    robot, laser, ptz = (str(twins.links / name) for name in ("robot", "laser", "ptz"))
    clock.run(leave_driving(robot))
    clock.run(clock.sleep(4.0))
    stood = twins.newest()
    assert stood is not None
    assert stood.pose.x > 0.3
    options = ["--port", robot, "--port", laser, "--port", ptz, "--out", str(config)]
    assert call(["probe", *options]) == 0
    said = capsys.readouterr().out
    assert f"{robot}: P2OS robot 'followerd_twin', Pioneer p3dx-sh, 9600 baud, battery 12." in said
    assert f"{laser}: laser LMS200;301061;V02.10, 180°/0.5°, mm, 9600 baud" in said
    assert f"{ptz}: Canon pan-tilt head" in said
    clock.run(clock.sleep(1.0))
    now = twins.newest()
    assert now is not None
    assert now.pose == stood.pose  # 0 mm
    assert call(["check", str(config)]) == 0
    assert call(["probe", *options]) == 2
    assert f"--out {config}: exists already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_port_that_is_in_use_or_not_there_is_one_line(
    simulation: Callable[[], Simulation], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot = str(simulation().links / "robot")

    async def occupied() -> int:
        stream = await open_link(robot).open("base", 9600)
        code = await asyncio.to_thread(call, ["probe", "--port", robot])
        stream.close()
        return code

    assert clock.run(occupied()) == 3
    assert f"{robot} is busy; used by " in capsys.readouterr().out
    assert call(["probe", "--port", "/dev/nowhere"]) == 3
    assert "/dev/nowhere does not exist; " in capsys.readouterr().out
