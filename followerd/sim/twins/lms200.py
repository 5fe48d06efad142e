"""The twin of a SICK LMS200: its modes, its line rate, its delivered scan rate, its errors.

The mirror turns from power-on; a telegram leaves when a scan is complete and the line is free, so
that the delivered period is a whole number of scan times. Scans are computed only when they are
sent. Not simulated: field evaluation, reflectors, commands outside `telegrams.Command`.
"""

from collections import deque
from collections.abc import Callable
from math import inf
from typing import NamedTuple

import numpy as np

from followerd.geometry import Pose2
from followerd.hw.lms200.protocol import FROM_DEVICE, Acknowledgement, Telegram, TelegramDecoder
from followerd.hw.lms200.scans import RANGE_BITS, Unit
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import (
    BAUD_CODES,
    BAUD_WORDS,
    FACTORY_CONFIG,
    HEALTHY,
    POLLUTED,
    POWER_ON_BAUD,
    BadTelegram,
    Command,
    Config,
    ErrorEntry,
    Mode,
    ModeResult,
    Reply,
    Status,
    VariantAnswer,
    answer,
    errors_data,
    reply_to,
    variant_of,
)
from followerd.hw.lms200.variant import ROTATION, VARIANTS, line_time
from followerd.sim.interfaces import Scene
from followerd.sim.twins.lms200_modes import STREAMING, mode_of, sweep_of
from followerd.sim.twins.lms200_scanner import Scanner

FIRMWARE = b"V02.10 "
BOOT_PROM = b"V01.27 "
CLEAN_WINDOW, DIRTY_WINDOW = 100, 60  # pollution readings
RESTART_AFTER_TIME = 1
RESOLUTION = 1e-9  # s; within it, a time has come
SILENCE = 0.1  # s in mid-telegram after which the device forgets its beginning
# s from a request to its answer; the rest is answered quickly
QUICKLY = 0.005
PROCESSING: dict[int, float] = {Command.MODE: 0.02, Command.WRITE_CONFIG: 0.4}


class _Answer(NamedTuple):
    ready: float  # s
    data: bytes
    then: Callable[[float], None] | None  # called when its last byte has left


class Lms200Twin:
    """Implements sim.interfaces.Twin. With a `boot_time` it is switched on by its first step."""

    def __init__(
        self,
        scene: Scene,
        rng: np.random.Generator,
        base_from_laser: Pose2,
        *,
        upside_down: bool = False,
        boot_time: float = 0.0,  # s, also after a reset
        power_on_baud: int = POWER_ON_BAUD,
        address: int = 0,
        polluted: bool = False,
        config: Config = FACTORY_CONFIG,
    ) -> None:
        self.baud = power_on_baud
        self.config = config
        self.status = HEALTHY | POLLUTED * polluted
        self.errors: tuple[ErrorEntry, ...] = ()  # in its fault memory
        self.mode = Mode.ON_REQUEST
        self.variant = VARIANTS[0]
        self.scanner = Scanner(scene, rng, base_from_laser, upside_down=upside_down)
        self._boot_time = boot_time
        self._power_on_baud = power_on_baud
        self._address = address
        self._decoder = TelegramDecoder(from_device=False)
        self._heard_at = -inf
        self._is_up = boot_time == 0.0
        self._up_at: float | None = None  # s, when it will be up; None = not switched on yet
        self._answers: deque[_Answer] = deque()
        self._line_free = 0.0  # s, when the last byte has left
        self._when_left: Callable[[float], None] | None = None
        self._parameters = b""  # of the mode
        self._scan_ready = inf  # s, when the next scan to be sent is complete
        self._sent = 0  # scan telegrams since the stream began

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host; a booting device hears nothing."""
        if not self._is_up:
            return
        rejected = self._decoder.rejected_frames
        events = self._decoder.give_up() if now - self._heard_at > SILENCE else []
        self._heard_at = now
        events += self._decoder.feed(data)
        if self._decoder.rejected_frames > rejected:
            self._answers.append(_Answer(now, bytes((Acknowledgement.NAK,)), None))
        for event in events:
            if isinstance(event, Telegram) and event.address in (0, self._address):
                self._answers.append(_Answer(now, bytes((Acknowledgement.ACK,)), None))
                self._obey(event, now)

    def step(self, now: float) -> bytes:
        """At most one telegram or acknowledgement that starts to leave now."""
        if not self._is_up:
            return self._boot(now)
        if now + RESOLUTION < self._line_free:
            return b""
        if self._when_left is not None:
            then, self._when_left = self._when_left, None
            then(now)
            return self.step(now)
        if self._answers and self._answers[0].ready <= now + RESOLUTION:
            due = self._answers.popleft()
            self._when_left = due.then
            return self._send(due.data, now)
        if self._scan_ready <= now + RESOLUTION:
            return self._send_scan(now)
        return b""

    def wake_at(self) -> float:
        """When something is due."""
        if not self._is_up:
            return 0.0 if self._up_at is None else self._up_at
        if self._when_left is not None:
            return self._line_free
        ready = self._answers[0].ready if self._answers else inf
        return max(self._line_free, min(ready, self._scan_ready))

    def reboot(self, now: float) -> None:
        """Switch off and on: silent for the boot time, then the power-on telegram.

        A telegram in mid-air ends where it is; what is not in EEPROM is forgotten.
        """
        self.baud = self._power_on_baud
        self.mode = Mode.ON_REQUEST
        self.variant = VARIANTS[0]
        self._scan_ready = inf
        self._answers.clear()
        self._when_left = None
        self._line_free = now
        self._decoder = TelegramDecoder(from_device=False)
        self._is_up = False
        self._up_at = now + self._boot_time

    def _boot(self, now: float) -> bytes:
        if self._up_at is None:
            self._up_at = now + self._boot_time
        if now + RESOLUTION < self._up_at:
            return b""
        self._is_up = True
        self.scanner.turning_since = now
        return self._send(self._answer(Reply.POWER_ON, self._type), now)

    def _send(self, data: bytes, start: float) -> bytes:
        self._line_free = start + line_time(len(data), self.baud)
        return data

    # -- requests ---------------------------------------------------------------------------

    def _answer(self, reply: int, data: bytes = b"") -> bytes:
        return answer(reply, data, self.status, self._address).to_bytes()

    def _reply(
        self,
        request: Telegram,
        now: float,
        data: bytes | None,
        then: Callable[[float], None] | None = None,
    ) -> None:
        """Queue the answer; without content the request is not allowed."""
        reply = Reply.NOT_ALLOWED if data is None else reply_to(request.command)
        ready = now + PROCESSING.get(request.command, QUICKLY)
        self._answers.append(_Answer(ready, self._answer(reply, data or b""), then))

    def _obey(self, request: Telegram, now: float) -> None:
        match request.command:
            case Command.RESET:
                self.errors = ()
                self._reply(request, now, b"", self.reboot)
            case Command.MODE:
                self._change_mode(request, now)
            case Command.SCAN if request.data == b"\1" and self.mode is Mode.ON_REQUEST:
                self._scan_ready = self.scanner.next_complete(now + self._sweep.age, self._sweep)
            case Command.STATUS:
                self._reply(request, now, self._status_report.to_data())
            case Command.ERRORS:
                self._reply(request, now, errors_data(self.errors))
            case Command.TYPE:
                self._reply(request, now, self._type)
            case Command.VARIANT:
                self._reply(request, now, self._change_variant(request.data))
            case Command.READ_CONFIG:
                self._reply(request, now, self.config.raw)
            case Command.WRITE_CONFIG if self.mode is Mode.INSTALLATION:
                self._reply(request, now, self._change_config(request.data))
            case _:
                self._reply(request, now, None)

    def _change_mode(self, request: Telegram, now: float) -> None:
        code, parameters = request.data[:1], request.data[1:]
        rates = [baud for baud, known in BAUD_CODES.items() if code == bytes((known,))]
        if rates:
            self._reply(request, now, bytes((ModeResult.OK,)), lambda _: self._set_baud(rates[0]))
            return
        mode = mode_of(code, parameters, self.variant)
        if mode is None:
            self._reply(request, now, bytes((ModeResult.REFUSED,)))
            return
        self.mode = mode
        self._parameters = parameters
        self._scan_ready = inf
        self._reply(request, now, bytes((ModeResult.OK,)), self._begin_stream)

    def _set_baud(self, baud: int) -> None:
        self.baud = baud

    def _change_variant(self, data: bytes) -> bytes | None:
        try:
            wanted = variant_of(data)
        except BadTelegram:
            return None
        done = wanted in VARIANTS and self.mode not in STREAMING
        if done:
            self.variant = wanted
        return VariantAnswer(done, self.variant).to_data()

    def _change_config(self, data: bytes) -> bytes:
        wanted = self.config.overwritten(data)
        done = wanted.measuring_mode in RANGE_BITS and wanted.unit in (Unit.CM, Unit.MM)
        if done:
            self.config = wanted
        return bytes((done,)) + self.config.raw

    @property
    def _type(self) -> bytes:
        return b"LMS200;30106%d;%s" % (1 if self.config.unit == Unit.MM else 3, FIRMWARE)

    @property
    def _status_report(self) -> Status:
        window = DIRTY_WINDOW if self.status & POLLUTED else CLEAN_WINDOW
        return Status(
            firmware=FIRMWARE,
            mode=self.mode,
            defective=False,
            is_special=False,
            pollution=(window,) * 8,
            pollution_calibration=(CLEAN_WINDOW,) * 8,
            revolutions=round(60 / ROTATION),
            measuring_mode=self.config.measuring_mode,
            variant=self.variant,
            restart=RESTART_AFTER_TIME,
            baud_word=BAUD_WORDS[self.baud],
            is_baud_permanent=self._power_on_baud != POWER_ON_BAUD,
            address=self._address,
            unit=self.config.unit,
            is_laser_off=False,
            boot_prom=BOOT_PROM,
        )

    # -- scans ------------------------------------------------------------------------------

    @property
    def _sweep(self) -> Sweep:
        """What the next scan telegram holds."""
        return sweep_of(self.mode, self._parameters, self.variant, self._sent)

    def _begin_stream(self, now: float) -> None:
        if self.mode in STREAMING:  # and was not stopped again before the answer had left
            self._sent = 0
            self._scan_ready = self.scanner.next_complete(now + self._sweep.age, self._sweep)

    def _send_scan(self, now: float) -> bytes:
        sweep = self._sweep
        late = (now - self._scan_ready) % sweep.period
        scan = self.scanner.measure(sweep, now - late, now, self.config, self.status, self._sent)
        frame = Telegram(FROM_DEVICE | self._address, scan.to_payload()).to_bytes()
        self._send(frame, now)
        self._sent += 1
        self._scan_ready = inf
        if self.mode in STREAMING:
            # lateness of the simulating computer costs no scan that the device would deliver
            self._scan_ready = self.scanner.next_complete(self._line_free - late, self._sweep)
        return frame
