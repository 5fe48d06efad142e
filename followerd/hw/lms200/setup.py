"""Setting a found laser up: rate, configuration, field and resolution, stream."""

from contextlib import suppress
from dataclasses import dataclass

import structlog

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.lms200.complaints import Complaint, complaint_of, dirtiest
from followerd.hw.lms200.protocol import Telegram
from followerd.hw.lms200.scans import Unit
from followerd.hw.lms200.search import find_rate
from followerd.hw.lms200.session import NoAnswer, Refused, Session
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    BAUD_WORDS,
    PASSWORD,
    POWER_ON_BAUD,
    Command,
    Config,
    ErrorEntry,
    Mode,
    ModeResult,
    Status,
    VariantAnswer,
    errors_of,
    variant_data,
    written_config,
)

TRIES = 2  # to bring the line to the configured rate
SETTLED = 0.3  # s that the device needs after a change of rate
SWITCH = "switch it off and on again"

log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class Found:
    """What a laser that now streams said of itself."""

    status: Status
    said: Telegram  # its last answer


class SetUp:
    """Brings the laser on `session` from any state that it answers in to streaming."""

    def __init__(self, name: str, settings: Lms200Settings, session: Session) -> None:
        self._name = name
        self._settings = settings
        self._session = session

    async def find(self) -> None:
        """Find the laser's rate, the one it was last met at first; see `find_rate`."""
        rates = (self._session.baud, self._settings.baud, POWER_ON_BAUD, 38400, 500000, 19200)
        await find_rate(self._session, self._name, tuple(dict.fromkeys(rates)))

    async def run(self) -> Found:
        """Everything from stopping a stream to starting one.

        Raises SetupError if refused, NoAnswer, Rebooted, BadTelegram or LinkLost.
        """
        session = self._session
        try:
            await self._set_mode(Mode.ON_REQUEST)
            status = await self._at_rate()
            kind = (await session.request(Command.TYPE)).data.decode("ascii", "replace").strip()
            if not kind.startswith("LMS2"):
                raise SetupError(self._name, f"is a {kind!r}, not an LMS2xx", "check `link`")
            self._report_health(status)
            await self._configure()
            await self._choose_variant()
            said = await self._set_mode(*self._settings.stream_mode)
        except Refused as reason:
            raise SetupError(self._name, f"does not allow {reason}", SWITCH) from reason
        log.info("laser set up", device=self._name, kind=kind, baud=session.baud)
        return Found(status, said)

    async def complaint(self, status: int) -> Complaint | None:
        """What is wrong by its status byte and its fault memory."""
        errors: tuple[ErrorEntry, ...] = ()
        with suppress(NoAnswer, Refused, SetupError):
            await self._set_mode(Mode.ON_REQUEST)
            errors = errors_of((await self._session.request(Command.ERRORS)).data)
        return complaint_of(status, errors)

    async def _at_rate(self) -> Status:
        """Bring the line to the configured rate; the device's own word counts, not the port's."""
        session, wanted = self._session, self._settings.baud
        for _ in range(TRIES):
            status = Status.from_data((await session.request(Command.STATUS)).data)
            if status.baud_word == BAUD_WORDS[wanted]:
                return status
            await self._set_mode(BAUD_CODES[wanted])
            await session.set_baud(wanted)
            await clock.sleep(SETTLED)
            try:
                return Status.from_data((await session.request(Command.STATUS)).data)
            except NoAnswer:
                await self.find()
        raise SetupError(
            self._name,
            f"is silent at {wanted} baud, though it accepts that rate",
            "500000 needs RS-422 and an adapter that can do it; else set `baud: 38400`",
        )

    async def _set_mode(self, mode: int, *parameters: int) -> Telegram:
        said = await self._session.request(Command.MODE, bytes((mode, *parameters)))
        if said.data != bytes((ModeResult.OK,)):
            raise SetupError(
                self._name,
                f"refuses mode 0x{mode:02X} (answer {said.data.hex() or 'empty'})",
                SWITCH,
            )
        return said

    def _report_health(self, status: Status) -> None:
        """Say what the device knows of its health; its scans' status decides on their use."""
        worst = dirtiest(status)
        log.info(
            "laser window",
            device=self._name,
            clear_percent=None if worst is None else round(100 * worst[1]),
            worst_channel=None if worst is None else worst[0],
        )
        if status.defective or status.is_laser_off:
            log.warning(
                "laser says that it is defective, or off",
                device=self._name,
                defective=status.defective,
                off=status.is_laser_off,
            )

    async def _configure(self) -> None:
        """Write measuring mode, unit and indices only if they differ: the EEPROM wears."""
        settings = self._settings
        found = Config((await self._session.request(Command.READ_CONFIG)).data)
        wanted = found.with_values(settings.measuring_mode, Unit[settings.unit.upper()])
        if settings.number_scans is not None:
            wanted = wanted.with_indices(settings.number_scans)
        if found == wanted:
            return
        await self._set_mode(Mode.INSTALLATION, *PASSWORD)
        answer = await self._session.request(Command.WRITE_CONFIG, wanted.raw)
        await self._set_mode(Mode.ON_REQUEST)
        if written_config(answer.data) != (True, wanted):
            raise SetupError(
                self._name,
                f"does not take unit {settings.unit} and measuring mode {settings.measuring_mode}",
                "set `unit` and `measuring_mode` to what it has",
            )
        log.info(
            "laser configuration written",
            device=self._name,
            unit=settings.unit,
            measuring_mode=settings.measuring_mode,
        )

    async def _choose_variant(self) -> None:
        settings = self._settings
        answer = await self._session.request(Command.VARIANT, variant_data(settings.variant))
        if VariantAnswer.from_data(answer.data) != (True, settings.variant):
            raise SetupError(
                self._name,
                f"does not take field_deg {settings.field_deg} with resolution_deg"
                f" {settings.resolution_deg:g}",
                "choose another field_deg or resolution_deg",
            )
