"""From an open line to a synchronised robot, whatever state it was left in.

SYNC0, SYNC1, SYNC2 are the same packets as PULSE, OPEN, CLOSE: a robot whose last session is still
open takes SYNC0 for a PULSE and resumes its last motion. So what stops it goes first, at every
line rate.
"""

from collections import deque
from collections.abc import Sequence
from enum import Enum

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.p2os.commands import Cmd, command
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.packet_stream import PacketStream
from followerd.hw.p2os.packets import RESET_NOTES
from followerd.hw.p2os.protocol import Packet
from followerd.hw.p2os.sip import TYPES as SIP_TYPES
from followerd.hw.p2os.writer import HALT

ANSWER = 0.35  # s to wait for a SYNC's echo
CLOSING = 0.4  # s until a closed session has fallen silent
BREATH = 0.1  # s between SYNC2's answer and OPEN
LAST_BYTES = 0.02  # s for CLOSE to cross the line before it is shut
BITS = 10  # of a byte on the line
IN_ADAPTER = 0.01  # s that written bytes may wait in a USB adapter
TRIES = 6  # SYNC rounds at one line rate
VISITS = 16  # line rates tried in all

LEAVE = HALT + command(Cmd.CLOSE)


class _Outcome(Enum):
    SILENT = "nobody answers"
    CLOSED = "an old session was closed"
    CONFUSED = "answers, but never rightly"


async def synchronise(
    line: PacketStream, bauds: Sequence[int], device: str, left_at: int | None = None
) -> Identity:
    """Connect, trying `bauds` in turn, the most likely flash rate first.

    Before them comes `left_at`, if a session was left open there. Raises LinkLost when nobody
    answers.
    """
    rates = deque([*bauds, *bauds] if left_at is None else [left_at, *bauds, *bauds])
    await _halt_at(line, [baud for baud in bauds if baud != rates[0]])
    problem = _Outcome.SILENT
    for _ in range(VISITS):
        if not rates:
            break
        baud = rates.popleft()
        line.set_baud(baud)
        outcome = await _synchronise_here(line)
        if isinstance(outcome, Identity):
            return outcome
        if outcome is not _Outcome.SILENT:
            problem = outcome
        if outcome is _Outcome.CLOSED:
            rates.extendleft((baud, bauds[0]))  # without a session it speaks at its flash rate
    raise LinkLost(
        device,
        f"no robot at {', '.join(map(str, bauds))} baud: {problem.value}",
        "switch the robot on, check the cable (null modem) and that no other program drives it",
    )


async def _halt_at(line: PacketStream, bauds: Sequence[int]) -> None:
    """Stop a robot that a dead program left driving, before it is looked for: that takes long."""
    for baud in bauds:
        line.set_baud(baud)
        line.write(HALT)
        await line.drain()
        await clock.sleep(BITS * len(HALT) / baud + IN_ADAPTER)


async def open_servers(line: PacketStream, device: str) -> None:
    """OPEN, until status packets flow; raises LinkLost when they do not."""
    await clock.sleep(BREATH)
    for _ in range(3):
        line.write(command(Cmd.OPEN))
        if await clock.within(ANSWER, _first(line, frozenset(SIP_TYPES))) is not None:
            return
    raise LinkLost(device, "connected, but sends no status packets", "switch it off and on")


async def take_leave(line: PacketStream) -> None:
    """Stop, motors off, close the session."""
    line.write(HALT + command(Cmd.ENABLE, 0))
    await clock.sleep(BREATH)
    line.write(command(Cmd.CLOSE))
    await line.drain()
    await clock.sleep(LAST_BYTES)


async def _synchronise_here(line: PacketStream) -> Identity | _Outcome:
    line.write(HALT)
    expected = silences = 0
    for _ in range(3 * TRIES):
        line.write(command(expected))
        packet = await clock.within(ANSWER, _first(line, SYNC_ANSWERS))
        if packet is None:
            silences += 1
            if silences == 2:
                return _Outcome.SILENT
            # connected without servers open, it answers to nothing but CLOSE
            line.write(LEAVE)
            await _quiet(line, BREATH)
            expected = 0
        elif packet.type in SIP_TYPES:
            line.write(LEAVE)
            await _quiet(line, CLOSING)
            return _Outcome.CLOSED
        elif packet.type != expected:
            await _quiet(line, BREATH)
            expected = 0
        elif expected < Cmd.CLOSE:
            expected += 1
        elif (identity := Identity.parse(packet.payload)) is not None:
            return identity
    return _Outcome.CONFUSED


SYNC_ANSWERS = frozenset({0, 1, 2, *RESET_NOTES, *SIP_TYPES})


async def _first(line: PacketStream, types: frozenset[int]) -> Packet:
    """The next packet of one of `types`."""
    while True:
        for arrived in await line.read():
            if arrived.packet.type in types:
                return arrived.packet


async def _quiet(line: PacketStream, seconds: float) -> None:
    """Let the robot finish talking, and forget what it said."""
    await clock.sleep(seconds)
    line.discard()
