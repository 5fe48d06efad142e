"""Driver of the SICK LMS200: finds it in any state, sets it up, streams scans."""

import asyncio
from contextlib import suppress
from dataclasses import dataclass

import structlog

from followerd import clock
from followerd.errors import DeviceError, LinkLost, SetupError
from followerd.hw.interfaces import Sink
from followerd.hw.lms200.protocol import Telegram
from followerd.hw.lms200.scans import ScanTelegram, Unit, longest_range, ranges_of
from followerd.hw.lms200.search import find_rate
from followerd.hw.lms200.session import NoAnswer, Rebooted, Refused, Session
from followerd.hw.lms200.settings import Lms200Settings, delivered_period
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    BAUD_WORDS,
    PASSWORD,
    POWER_ON_BAUD,
    BadTelegram,
    Command,
    Config,
    Mode,
    ModeResult,
    Reply,
    Status,
    VariantAnswer,
    is_degraded,
    is_usable,
    variant_data,
    written_config,
)
from followerd.hw.stream import Link
from followerd.messages import Scan

MEASURING_MODE = 0  # 13 bits of range, dazzle flagged
FAILURES = 2  # set-ups or streams that fail before the link counts as lost
SILENCE_PERIODS, SILENCE = 3, 0.5  # scans, s: the longer of the two without a scan is a failure
SETTLED = 0.3  # s that the device needs after a change of rate
LEAVE, LEAVE_RATE = 0.28, 0.15  # s to wait for the answers when taking leave

log = structlog.get_logger(__name__)


@dataclass(slots=True)
class Counters:
    """What came of the telegrams since the driver was made."""

    scans: int = 0
    unusable_scans: int = 0  # device in error, or not what was asked for
    last_bad_status: int | None = None  # since the last set-up


class Lms200:
    """Implements hw.interfaces.Sensor."""

    role = "laser"
    Settings = Lms200Settings

    def __init__(self, settings: Lms200Settings, link: Link, name: str = "laser") -> None:
        self.name = name
        self.counters = Counters()
        self._settings = settings
        self._link = link
        self._variant = settings.variant
        self._base_from_laser = settings.mount.base_from_laser
        self._order = slice(None, None, -1 if settings.mount.upside_down else 1)
        times = self._variant.beam_times
        self._beam_times = (times - times[0])[self._order]
        self._age = self._variant.age - float(times[0])  # of the first beam, at the first byte
        self._increment = float(self._variant.bearings[1] - self._variant.bearings[0])
        self._silence = max(SILENCE_PERIODS * delivered_period(settings), SILENCE)
        self._last_baud: int = settings.baud
        self._boots_at_9600 = True

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
        await self._find(session)
        failures = 0
        problem = ""
        while failures < FAILURES:
            try:
                await self._set_up(session)
                while scan := await clock.within(self._silence, self._next_scan(session)):
                    failures = 0
                    sink(scan)
                problem = f"no usable scan for {self._silence:.1f} s{self._complaint()}"
            except Rebooted:
                log.warning("laser has rebooted", device=self.name)
                await self._find(session)
                continue
            except (NoAnswer, BadTelegram) as reason:
                problem = str(reason)
            failures += 1
            log.warning("laser fails", device=self.name, problem=problem)
        raise LinkLost(self.name, problem, "check its cable and 24 V supply")

    async def _find(self, session: Session) -> None:
        rates = (self._last_baud, self._settings.baud, POWER_ON_BAUD, 38400, 500000, 19200)
        await find_rate(session, self.name, tuple(dict.fromkeys(rates)))
        self._last_baud = session.baud

    # -- set-up -----------------------------------------------------------------------------

    async def _set_up(self, session: Session) -> None:
        """Everything from stopping a stream to starting one; raises SetupError if refused."""
        self.counters.last_bad_status = None
        try:
            await self._set_mode(session, Mode.ON_REQUEST)
            status = await self._at_rate(session)
            kind = (await session.request(Command.TYPE)).data.decode("ascii", "replace").strip()
            if not kind.startswith("LMS2"):
                raise SetupError(self.name, f"is a {kind!r}, not an LMS2xx", "check `link`")
            await self._configure(session)
            await self._choose_variant(session)
            await self._set_mode(session, Mode.STREAM)
        except Refused as reason:
            raise SetupError(
                self.name, f"does not allow {reason}", "switch it off and on again"
            ) from reason
        self._last_baud = session.baud
        self._boots_at_9600 = not status.is_baud_permanent
        log.info("laser set up", device=self.name, kind=kind, baud=session.baud)

    async def _at_rate(self, session: Session) -> Status:
        """Bring the line to the configured rate; the device's own word counts, not the port's."""
        wanted = self._settings.baud
        for _ in range(FAILURES):
            status = Status.from_data((await session.request(Command.STATUS)).data)
            if status.baud_word == BAUD_WORDS[wanted]:
                return status
            await self._set_mode(session, BAUD_CODES[wanted])
            await session.set_baud(wanted)
            await clock.sleep(SETTLED)
            try:
                return Status.from_data((await session.request(Command.STATUS)).data)
            except NoAnswer:
                await self._find(session)
        raise SetupError(
            self.name,
            f"is silent at {wanted} baud, though it accepts that rate",
            "500000 needs RS-422 and an adapter that can do it; else set `baud: 38400`",
        )

    async def _set_mode(self, session: Session, mode: int, parameters: bytes = b"") -> None:
        data = (await session.request(Command.MODE, bytes((mode,)) + parameters)).data
        if data != bytes((ModeResult.OK,)):
            raise SetupError(
                self.name,
                f"refuses mode 0x{mode:02X} (answer {data.hex() or 'empty'})",
                "switch it off and on again",
            )

    async def _configure(self, session: Session) -> None:
        """Write measuring mode and unit only if they differ: the EEPROM wears."""
        found = Config((await session.request(Command.READ_CONFIG)).data)
        wanted = found.with_values(MEASURING_MODE, Unit[self._settings.unit.upper()])
        if found == wanted:
            return
        await self._set_mode(session, Mode.INSTALLATION, PASSWORD)
        answer = await session.request(Command.WRITE_CONFIG, wanted.raw)
        await self._set_mode(session, Mode.ON_REQUEST)
        if written_config(answer.data) != (True, wanted):
            raise SetupError(
                self.name,
                f"does not take unit {self._settings.unit} and measuring mode {MEASURING_MODE}",
                "set `unit` to what it has",
            )
        log.info("laser configuration written", device=self.name, unit=self._settings.unit)

    async def _choose_variant(self, session: Session) -> None:
        answer = await session.request(Command.VARIANT, variant_data(self._variant))
        if VariantAnswer.from_data(answer.data) != (True, self._variant):
            raise SetupError(
                self.name,
                f"does not take field_deg {self._settings.field_deg} with resolution_deg"
                f" {self._settings.resolution_deg:g}",
                "choose another field_deg or resolution_deg",
            )

    # -- streaming --------------------------------------------------------------------------

    async def _next_scan(self, session: Session) -> Scan:
        """The next usable scan; raises Rebooted or LinkLost."""
        while True:
            event = await session.event()
            if isinstance(event, Telegram):
                if event.command == Reply.POWER_ON:
                    raise Rebooted
                if event.command == Reply.SCAN and (scan := self._scan(event, session)):
                    self.counters.scans += 1
                    return scan

    def _scan(self, telegram: Telegram, session: Session) -> Scan | None:
        """The measurement in a telegram; None when it must not be used."""
        try:
            sent = ScanTelegram.from_payload(telegram.payload)
        except BadTelegram:
            self.counters.unusable_scans += 1
            return None
        if not is_usable(sent.status) or sent.partial or len(sent.words) != self._variant.count:
            self.counters.unusable_scans += 1
            self.counters.last_bad_status = sent.status
            return None
        return Scan(
            stamp=session.arrived_at(telegram) - self._age,
            received=session.received_at,
            angle_min=float(self._variant.bearings[0]),
            angle_increment=self._increment,
            ranges=ranges_of(sent.words, MEASURING_MODE, sent.unit)[self._order],
            range_max=longest_range(MEASURING_MODE, sent.unit),
            beam_times=self._beam_times,
            base_from_laser=self._base_from_laser,
            degraded=is_degraded(sent.status),
        )

    def _complaint(self) -> str:
        """What the device said of itself when it was last not usable."""
        status = self.counters.last_bad_status
        return "" if status is None else f", the device's last status is 0x{status:02X}"

    async def _take_leave(self, session: Session) -> None:
        """Stop the stream and go back to the power-on rate, so that anything finds it again."""
        session.send(Command.MODE, bytes((Mode.ON_REQUEST,)))
        await session.await_one(Reply.MODE, LEAVE)
        if session.baud != POWER_ON_BAUD and self._boots_at_9600:
            session.send(Command.MODE, bytes((BAUD_CODES[POWER_ON_BAUD],)))
            await session.await_one(Reply.MODE, LEAVE_RATE)
            self._last_baud = POWER_ON_BAUD
