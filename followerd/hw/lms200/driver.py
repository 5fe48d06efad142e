"""Driver of the SICK LMS200: finds it in any state, sets it up, streams scans."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import structlog

from followerd import clock
from followerd.errors import DeviceError, LinkLost
from followerd.hw.interfaces import Sink
from followerd.hw.lms200.assembler import Assembler, Counters
from followerd.hw.lms200.complaints import POWER_CYCLE
from followerd.hw.lms200.protocol import Telegram
from followerd.hw.lms200.session import GAP, NoAnswer, Rebooted, Refused, Session
from followerd.hw.lms200.settings import Lms200Settings, delivered_period, under_way
from followerd.hw.lms200.setup import SetUp
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    POWER_ON_BAUD,
    BadTelegram,
    Command,
    Mode,
    Reply,
)
from followerd.hw.stream import Link
from followerd.messages import Scan

FAILURES = 2  # set-ups or streams that fail before the link counts as lost
SILENCE_PERIODS, SILENCE = 3, 0.5  # scans, s: the longer of the two without a scan is a failure
FOREIGN = 3  # scans in a row of another shape: someone else has set the laser up
LEAVE, LEAVE_RATE = 0.28, 0.15  # s to wait for the answers when taking leave
SCANS = (Reply.SCAN, Reply.MEAN, Reply.SUBRANGE, Reply.MEAN_SUBRANGE)
CHECK = "check its cable and 24 V supply"

log = structlog.get_logger(__name__)


def _no_listener(stream: str) -> None:
    """Nobody asks what is coming."""


class NoScans(Exception):
    """The stream ended, or is of no use; says how, and what to do."""

    def __init__(self, problem: str, remedy: str = CHECK) -> None:
        super().__init__(problem)
        self.remedy = remedy


class Lms200:
    """Implements hw.interfaces.Sensor."""

    role = "laser"
    Settings = Lms200Settings

    def __init__(self, settings: Lms200Settings, link: Link, name: str = "laser") -> None:
        self.name = name
        self.counters = Counters()
        self._settings = settings
        self._link = link
        period = delivered_period(settings)
        self.on_begun: Callable[[str], None] = _no_listener
        self._expected = min(sweep.telegram_bytes for sweep in settings.sweeps)
        self._heralds = under_way(settings) > 0.0  # scans, by the first bytes of their telegrams
        self._late = period + 2 * GAP
        self._silence = max(SILENCE_PERIODS * period, SILENCE)
        self._last_baud: int = settings.baud
        self._boots_at_9600 = True
        self._was_degraded = False
        self._was_used = False  # the newest telegram of a scan

    @property
    def errors(self) -> int:
        """See CountsErrors: telegrams that were broken or of no use."""
        counted = self.counters
        return counted.broken_telegrams + counted.unusable_scans + counted.implausible_scans

    async def run(self, sink: Sink) -> None:
        """See hw.interfaces.Sensor. A laser that boots is waited for, for a minute."""
        stream = await self._link.open(self.name, self._last_baud)
        session = Session(stream, self._last_baud)
        try:
            await self._serve(session, sink)
        except asyncio.CancelledError:
            with suppress(DeviceError, Refused, Rebooted):
                await self._take_leave(session)
            raise
        finally:
            stream.close()

    async def _serve(self, session: Session, sink: Sink) -> None:
        set_up = SetUp(self.name, self._settings, session)
        await set_up.find()
        failures, problem, remedy = 0, "", ""
        while failures < FAILURES:
            scans = self.counters.scans
            try:
                await self._stream(session, set_up, sink)
            except Rebooted:
                log.warning("laser has rebooted", device=self.name)
                await set_up.find()
                continue
            except NoScans as reason:
                problem, remedy = str(reason), reason.remedy
            except (NoAnswer, BadTelegram) as reason:
                problem, remedy = str(reason), CHECK
            failures = 1 if self.counters.scans > scans else failures + 1
            self._last_baud = session.baud
            log.warning("laser fails", device=self.name, problem=problem)
        raise LinkLost(self.name, problem, remedy)

    async def _stream(self, session: Session, set_up: SetUp, sink: Sink) -> None:
        """Set the laser up and pass its scans on until they fail to come; then NoScans."""
        found = await set_up.run()
        self._last_baud = session.baud
        self._boots_at_9600 = not found.status.is_baud_permanent
        assembler = Assembler(self._settings, found.said, self.counters)
        while await self._passes_on(session, assembler, sink):
            pass
        problem = f"no usable scan for {self._silence:.1f} s"
        if assembler.is_frozen:
            raise NoScans("it sends the same scan again and again", POWER_CYCLE)
        if assembler.last_bad_status is None:
            raise NoScans(problem)
        complaint = await set_up.complaint(assembler.last_bad_status)
        if complaint is None:
            raise NoScans(problem)
        raise NoScans(f"{problem}, it {complaint.problem}", complaint.remedy)

    async def _passes_on(self, session: Session, assembler: Assembler, sink: Sink) -> bool:
        """Pass scans on for a while; whether any came, or did before the laser counts as silent.

        When they are late, it may be that a telegram was cut and its rest is waited for.
        """
        before, begun = self.counters.scans, clock.now()
        rejected = session.decoder.rejected_frames
        passing_on = self._pass_on(session, assembler, sink, self._expected)
        await clock.within(self._late, passing_on)
        while self.counters.scans == before and clock.now() - begun < self._silence:
            passing_on = self._pass_on(session, assembler, sink)
            await clock.within(GAP, passing_on)
            session.give_up_if_silent()
        self.counters.broken_telegrams += session.decoder.rejected_frames - rejected
        return self.counters.scans > before

    async def _pass_on(
        self, session: Session, assembler: Assembler, sink: Sink, expected: int = 1
    ) -> None:
        """Pass usable scans on, for ever; raises Rebooted, NoScans or LinkLost."""
        begun = None
        if self._heralds:
            expected, begun = assembler.telling_bytes, partial(self._herald, assembler)
        while True:
            event = await session.event(expected, begun)
            if not isinstance(event, Telegram):
                continue
            if event.command == Reply.POWER_ON:
                raise Rebooted
            if event.command not in SCANS:
                continue
            scan = assembler.scan(event, session.arrived_at(event), session.received_at)
            self._was_used = scan is not None
            if scan is not None:
                self._warn_of(scan)
                sink(scan)
            elif assembler.foreign >= FOREIGN:
                raise NoScans("it sends other scans than asked for", "close what else uses it")

    def _herald(self, assembler: Assembler, begun: bytes) -> None:
        """A device that repeats itself, or is in error, has nothing to come."""
        if self._was_used and assembler.expects(begun):
            self.on_begun("scan")

    def _warn_of(self, scan: Scan) -> None:
        """Say once that the laser warns."""
        if scan.degraded and not self._was_degraded:
            log.warning("laser warns, clean its window", device=self.name)
        self._was_degraded = scan.degraded

    async def _take_leave(self, session: Session) -> None:
        """Stop the stream and go back to the power-on rate, so that anything finds it again."""
        session.send(Command.MODE, bytes((Mode.ON_REQUEST,)))
        await session.await_one(Reply.MODE, LEAVE)
        if session.baud != POWER_ON_BAUD and self._boots_at_9600:
            session.send(Command.MODE, bytes((BAUD_CODES[POWER_ON_BAUD],)))
            await session.await_one(Reply.MODE, LEAVE_RATE)
            self._last_baud = POWER_ON_BAUD
