"""A device on the base's AUX port is spoken to as if it were plugged into this computer."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from followerd import clock
from followerd.errors import DeviceError, LinkLost, OpenError
from followerd.hw.p2os.aux_exchange import PATIENCE, AuxExchange
from followerd.hw.p2os.commands import Cmd, Request
from followerd.hw.p2os.driver import CANON
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.stream import ByteStream, Link
from followerd.hw.vcc50i.commands import POSITION, STATUS, ZOOM_POSITION
from followerd.hw.vcc50i.commands import Cmd as HeadCmd
from followerd.hw.vcc50i.driver import Vcc50i, Vcc50iSettings
from followerd.hw.vcc50i.protocol import Request as HeadRequest
from followerd.hw.vcc50i.replies import rest_of_answer
from followerd.messages import Command, Measurement, Twist
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests.p2os_bench import Bench, bench, story
from tests.p2os_body import AuxDevice

POSITION_REPLY = bytes.fromhex("FE 30 30 30 30 38 31 30 42 37 46 41 37 EF")
OK = bytes.fromhex("FE 30 30 30 30 EF")
REFUSED = bytes.fromhex("FE 30 30 39 30 EF")


def requests(data: bytes) -> list[tuple[int, int | bytes | None]]:
    parsed = [Request.parse(packet.payload) for packet in PacketDecoder().feed(data)]
    return [(request.number, request.argument) for request in parsed]


@asynccontextmanager
async def plugged(
    reply: Callable[[bytes], bytes], **options: Any
) -> AsyncIterator[tuple[Bench, AuxDevice, ByteStream]]:
    """A device on AUX 1 of a connected base, and the open stream to it."""
    async with bench(**options) as b:
        device = AuxDevice(reply)
        b.twin.attach_aux(device)
        await b.connect()
        yield b, device, await b.base.aux_link().open("ptz", 9600)


async def heard(stream: ByteStream, seconds: float = 1.0) -> bytes:
    """All that comes within a while."""
    data = b""
    until = clock.now() + seconds
    while (received := await clock.within(until - clock.now(), stream.read())) is not None:
        data += received.data
    return data


def test_the_shortest_reply_is_asked_for_first_and_then_the_rest_of_the_expected() -> None:
    exchange = AuxExchange(1, CANON)
    (said,) = exchange.say(POSITION.to_bytes(), 0.0)
    assert requests(said) == [
        (Cmd.GETAUX, 0),
        (Cmd.GETAUX, 6),
        (Cmd.TTY2, bytes.fromhex("FF 30 30 00 63 EF")),
    ]
    assert requests(exchange.hear(POSITION_REPLY[:6], 0.1)) == [(Cmd.GETAUX, 8)]
    assert exchange.hear(POSITION_REPLY[6:], 0.2) == b""
    assert exchange.overdue(9.0) == b""


def test_an_error_reply_ends_early_and_nothing_more_is_asked_for() -> None:
    exchange = AuxExchange(1, CANON)
    exchange.say(POSITION.to_bytes(), 0.0)
    assert exchange.hear(REFUSED, 0.1) == b""


def test_a_reply_longer_than_expected_is_fetched_byte_by_byte() -> None:
    exchange = AuxExchange(2, CANON)
    exchange.say(b"?", 0.0)
    assert requests(exchange.hear(b"\xfe00001", 0.1)) == [(Cmd.GETAUX2, 1)]
    assert requests(exchange.hear(b"2", 0.2)) == [(Cmd.GETAUX2, 1)]
    assert exchange.hear(b"\xef", 0.3) == b""


def test_a_reply_that_does_not_come_is_flushed_once() -> None:
    exchange = AuxExchange(3, CANON)
    exchange.say(b"?", 1.0)
    assert exchange.overdue(1.0 + PATIENCE - 0.01) == b""
    exchange.wait_from(1.3)  # it had not left yet
    assert exchange.overdue(1.3 + PATIENCE - 0.01) == b""
    assert requests(exchange.overdue(1.3 + PATIENCE)) == [(Cmd.GETAUX3, 0)]
    assert exchange.overdue(9.0) == b""
    assert exchange.hear(b"late", 9.0) == b""


def test_long_requests_go_out_in_pieces() -> None:
    head, *tail = AuxExchange(1, CANON).say(bytes(400), 0.0)
    strings = [argument for part in (head, *tail) for number, argument in requests(part)][2:]
    assert b"".join(part for part in strings if isinstance(part, bytes)) == bytes(400)


@pytest.mark.parametrize(
    ("request_", "rest"),
    [(STATUS, 3), (POSITION, 8), (ZOOM_POSITION, 4), (HeadRequest(HeadCmd.HOME), 0)],
)
def test_the_rest_of_a_canon_heads_answer_is_known(request_: HeadRequest, rest: int) -> None:
    assert rest_of_answer(request_.to_bytes()) == rest
    assert rest_of_answer(b"\xff") == 0


@pytest.mark.parametrize("queues", [False, True])
@pytest.mark.parametrize("reply", [POSITION_REPLY, REFUSED, OK + OK], ids=["14", "6", "6 and 6"])
def test_a_reply_of_any_length_comes_through(reply: bytes, queues: bool) -> None:
    async def told() -> None:
        async with plugged(lambda _: reply, queues_getaux=queues) as (_, device, stream):
            for _ in range(3):
                asked = clock.now()
                stream.write(POSITION.to_bytes())
                said = b""
                while not said.endswith(reply[-1:]):
                    said += (await stream.read()).data
                assert said == reply[: len(said)]
                assert clock.now() - asked < 0.35
            assert [data for _, data in device.heard] == [POSITION.to_bytes()] * 3

    story(told)


@pytest.mark.parametrize("queues", [False, True])
def test_a_reply_that_lost_bytes_costs_that_reply_only(queues: bool) -> None:
    replies = [POSITION_REPLY[:9], b"", POSITION_REPLY[2:], POSITION_REPLY, POSITION_REPLY]

    async def told() -> None:
        async with plugged(lambda _: replies.pop(0), queues_getaux=queues) as (_, _, stream):
            for _ in range(4):
                stream.write(POSITION.to_bytes())
                await heard(stream, 0.9)
            stream.write(POSITION.to_bytes())
            assert await heard(stream, 0.9) == POSITION_REPLY

    story(told)


def test_the_line_rate_of_the_port_is_set() -> None:
    async def told() -> None:
        async with bench() as b:
            device = AuxDevice(lambda _: OK, baud=19200)
            b.twin.attach_aux(device, port=2)
            await b.connect()
            stream = await b.base.aux_link(2).open("ptz", 19200)
            stream.write(b"one")
            assert await heard(stream, 0.3) == OK
            stream.set_baud(9600)
            device.baud = 9600
            stream.write(b"two")
            await stream.drain()
            assert await heard(stream, 0.3) == OK
            assert [data for _, data in device.heard] == [b"one", b"two"]

    story(told)


def test_bytes_for_the_port_wait_until_the_robot_stands_or_may_move() -> None:
    async def told() -> None:
        async with plugged(lambda _: OK) as (b, device, stream):
            await b.motors_on()
            await b.drive(Twist(0.5, 0.0), 2.0)
            stream.write(b"while driving")
            await b.drive(Twist(0.5, 0.0), 0.1)
            assert [data for _, data in device.heard] == [b"while driving"]
            b.base.drive(Command(clock.now()))
            stream.write(b"while stopping")
            first = len(b.twin.heard)
            while len(device.heard) == 1:
                assert clock.now() < 30
                await clock.sleep(0.01)
            assert b.body.is_still
            told_meanwhile = [number for number, _ in b.twin.heard[first:]]
            before = told_meanwhile.index(Cmd.GETAUX)
            assert set(told_meanwhile[:before]) == {Cmd.STOP, Cmd.VEL, Cmd.RVEL}

    story(told)


def test_passing_bytes_on_does_not_hold_back_a_setpoint() -> None:
    async def told() -> None:
        async with plugged(lambda _: b"", auto_baud=0) as (b, _, stream):
            await b.motors_on()
            for step in range(40):
                stream.write(bytes(20))
                await b.drive(Twist(0.2 + 0.01 * (step % 2), 0.0), 0.1)
            setpoints = [
                now
                for now, (number, value) in zip(b.twin.heard_at, b.twin.heard, strict=True)
                if number == Cmd.VEL and value
            ]
            assert np.diff(setpoints).max() < 0.16

    story(told)


def test_a_device_waits_for_its_base_and_is_lost_with_it() -> None:
    async def told() -> None:
        async with bench() as b:
            b.twin.attach_aux(AuxDevice(lambda _: OK))
            link: Link = b.base.aux_link()
            assert link.name == "base:aux1"
            opening = asyncio.create_task(link.open("ptz", 9600))
            await clock.sleep(1.0)
            assert not opening.done()
            b.restart()
            stream = await opening
            b.line.unplug()
            with pytest.raises(LinkLost, match="ptz: the link to base is lost"):
                await stream.read()
            with pytest.raises(LinkLost):
                stream.write(b"?")
            stream.close()
            await clock.sleep(0.1)
            b.line.replug()
            b.restart()
            again = await link.open("ptz", 9600)
            again.write(b"?")
            assert await heard(again, 0.3) == OK

    story(told)


def test_a_port_serves_one_device() -> None:
    async def told() -> None:
        async with plugged(lambda _: OK) as (b, _, stream):
            with pytest.raises(OpenError, match="base:aux1 is busy"):
                await b.base.aux_link().open("other", 9600)
            stream.close()
            stream.close()
            again = await b.base.aux_link().open("other", 9600)
            again.write(b"?")
            await clock.sleep(0.3)
            again.discard_input()
            assert await heard(again, 0.3) == b""
            with pytest.raises(OpenError, match="has no 4800 baud; choose one of 9600"):
                await b.base.aux_link().open("other", 4800)
            with pytest.raises(ValueError, match="AUX ports 1 to 3, not 4"):
                b.base.aux_link(4)

    story(told)


def test_without_a_base_the_port_does_not_open() -> None:
    async def told() -> None:
        async with bench() as b:
            with pytest.raises(OpenError, match="no base is connected"):
                await b.base.aux_link().open("ptz", 9600)

    story(told)


def test_a_port_that_nothing_passes_overflows() -> None:
    async def told() -> None:
        async with plugged(lambda _: b"") as (b, _, stream):
            await b.motors_on()
            await b.drive(Twist(0.5, 0.0), 2.0)
            b.base.drive(Command(clock.now()))

            def flood() -> None:
                for _ in range(100):
                    stream.write(bytes(100))

            with pytest.raises(LinkLost, match="takes no more bytes"):
                flood()

    story(told)


def test_a_canon_head_on_the_port_is_set_up_and_turns() -> None:
    async def told() -> None:
        async with bench() as b:
            twin = Vcc50iTwin(np.random.default_rng(4))
            b.twin.attach_aux(twin)
            await b.connect()
            head = Vcc50i(Vcc50iSettings(), b.base.aux_link())
            seen: list[Measurement] = []
            running = asyncio.create_task(head.run(seen.append))
            while not seen:
                assert not running.done()
                assert clock.now() < 60
                await clock.sleep(0.1)
            head.look(0.5, 0.1)
            await clock.sleep(4.0)
            assert not running.done()
            assert twin.head.pan.position == pytest.approx(-np.degrees(0.5) / 0.1125, abs=1)
            assert twin.head.tilt.position == pytest.approx(np.degrees(0.1) / 0.1125, abs=1)
            assert len(seen) > 3
            running.cancel()
            with pytest.raises((asyncio.CancelledError, DeviceError)):
                await running

    story(told)
