"""Who the robot on a line is: asked in a session of its own, motors off, that is closed again."""

from contextlib import suppress
from dataclasses import dataclass

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.p2os.commands import Cmd, command
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.driver import SWEEP
from followerd.hw.p2os.handshake import LEAVE, SYNC_ANSWERS, open_servers, synchronise, take_leave
from followerd.hw.p2os.models import find
from followerd.hw.p2os.packet_stream import PacketStream
from followerd.hw.p2os.sip import TYPES, Flags, Sip
from followerd.hw.p2os.writer import HALT

RATES = SWEEP
CROSSED = 0.05  # s for what was said to cross the line, and be obeyed
ANSWER = 0.25  # s for the echo
REPORT = 0.5  # s for a status packet


@dataclass(frozen=True, slots=True)
class RobotFound:
    """What a robot said of itself."""

    identity: Identity
    baud: int  # without a session: that of its flash
    volts: float | None  # None: it sent no status packet
    stop_button: bool

    @property
    def is_known(self) -> bool:
        """Whether the driver knows the type."""
        return find(self.identity.subclass) is not None

    def __str__(self) -> str:
        who = self.identity
        text = f"P2OS robot {who.name!r}, {who.robot_class} {who.subclass}, {self.baud} baud"
        text += ", battery unknown" if self.volts is None else f", battery {self.volts:.1f} V"
        if not self.is_known:
            text += "; unknown type: set base.model to the nearest"
        return text + ("; its STOP button is pressed" if self.stop_button else "")


async def knock(line: PacketStream) -> bool:
    """Whether a robot answers at the line's rate; raises LinkLost.

    What stops it goes first, and closes a session that was left open: only then is SYNC0, which
    is also PULSE, no order to go on.
    """
    line.write(LEAVE)
    await line.drain()
    await clock.sleep(CROSSED + 10 * len(LEAVE) / line.baud)
    line.discard()
    line.write(HALT + command(Cmd.PULSE))
    crossing = 10 * len(HALT) / line.baud
    return await clock.within(crossing + ANSWER, _first(line, SYNC_ANSWERS)) is not None


async def introduce(line: PacketStream, device: str) -> RobotFound:
    """What the robot at the line's rate, or another, says of itself; raises LinkLost."""
    try:
        rates = (line.baud, *(baud for baud in RATES if baud != line.baud))
        identity = await synchronise(line, rates, device)
        await open_servers(line, device)
        payload = await clock.within(REPORT, _first(line, frozenset(TYPES)))
        sip = None if payload is None else Sip.parse(payload)
    finally:
        with suppress(LinkLost):
            await take_leave(line)
    model = find(identity.subclass)
    tells = sip is not None and model is not None and model.has_flags
    return RobotFound(
        identity,
        line.baud,
        None if sip is None else sip.volts,
        bool(tells and sip is not None and sip.flags & Flags.STOP_BUTTON),
    )


async def _first(line: PacketStream, types: frozenset[int]) -> bytes:
    """The payload of the next packet of one of `types`."""
    while True:
        for arrived in await line.read():
            if arrived.packet.type in types:
                return arrived.packet.payload
