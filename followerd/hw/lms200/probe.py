"""Which laser is on a line: asked for its status and type, which changes nothing in it."""

from dataclasses import dataclass

from followerd.hw.lms200.complaints import Complaint, complaint_of, dirtiest
from followerd.hw.lms200.protocol import Acknowledgement, Telegram
from followerd.hw.lms200.scans import Unit
from followerd.hw.lms200.session import ANSWERED_ELSE, Rebooted, Refused, Session
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    BAUD_WORDS,
    Command,
    Mode,
    Reply,
    Status,
    errors_of,
)

RATES = tuple(BAUD_CODES)  # 500000 last: many adapters cannot
ANSWER = 0.2  # s; it acknowledges after some 60 ms


@dataclass(frozen=True, slots=True)
class LaserFound:
    """What a laser said of itself."""

    kind: str  # its type string
    status: Status
    address: int
    was_streaming: bool
    complaint: Complaint | None

    @property
    def baud(self) -> int | None:
        """Its line rate now, by its own word; None for one that we do not know."""
        rates = [baud for baud, word in BAUD_WORDS.items() if word == self.status.baud_word]
        return rates[0] if rates else None

    @property
    def unit(self) -> str:
        """Of its ranges."""
        known = self.status.unit in (Unit.CM, Unit.MM)
        return Unit(self.status.unit).name.lower() if known else f"unit {self.status.unit}"

    def __str__(self) -> str:
        status, worst = self.status, dirtiest(self.status)
        variant = status.variant
        window = "" if worst is None else f", window {100 * worst[1]:.0f} % clear"
        text = (
            f"laser {self.kind}, {variant.field}°/{variant.resolution / 100:g}°, {self.unit},"
            f" {self.baud or 'unknown'} baud, address {self.address}{window}"
        )
        if self.was_streaming:
            text += ", was streaming and was stopped"
        if self.complaint is not None:
            text += f"; it {self.complaint.problem}: {self.complaint.remedy}"
        return text


async def knock(session: Session) -> bool:
    """Whether a laser answers at the session's rate; raises LinkLost."""
    session.send(Command.STATUS)
    try:
        first = await session.await_one(Reply.STATUS, ANSWER, or_mark=True)
        if isinstance(first, Acknowledgement):
            first = await session.await_one(Reply.STATUS, ANSWERED_ELSE)
    except (Rebooted, Refused):
        return True
    return isinstance(first, Telegram)


async def introduce(session: Session, *, was_streaming: bool) -> LaserFound:
    """What the laser at the session's rate says; a stream is stopped, for it delays the answers.

    Raises NoAnswer, Refused, Rebooted, BadTelegram or LinkLost.
    """
    if was_streaming:
        await session.request(Command.MODE, bytes((Mode.ON_REQUEST,)))
    kind = (await session.request(Command.TYPE)).data.decode("ascii", "replace").strip()
    said = await session.request(Command.STATUS)
    errors = errors_of((await session.request(Command.ERRORS)).data)
    status = Status.from_data(said.data)
    complaint = complaint_of(said.status, errors)
    return LaserFound(kind, status, status.address, was_streaming, complaint)
