"""From scan telegrams to scans: what fits the set-up, is new, and can be."""

from dataclasses import dataclass

import numpy as np

from followerd.geometry import Array
from followerd.hw.lms200.flags import reflection_of
from followerd.hw.lms200.protocol import HEADER, Telegram
from followerd.hw.lms200.scans import ScanTelegram, Unit, longest_range, ranges_of
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.lms200.spikes import SpikeGate
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import SOURCE, is_degraded, is_usable
from followerd.messages import Scan

TELLING = 50  # ranges; so many never come out the same twice, but for long means
INDICES = 256  # they count modulo this


@dataclass(slots=True)
class Counters:
    """What came of the telegrams since the driver was made."""

    scans: int = 0
    broken_telegrams: int = 0  # while it streamed: the checksum is wrong
    unusable_scans: int = 0  # device in error, or not what was asked for
    repeated_scans: int = 0  # the same telegram again: the line's doing, or a frozen device
    implausible_scans: int = 0  # too many ranges out of the blue
    implausible_ranges: int = 0  # in scans that were else used
    lost_telegrams: int = 0  # sent and not received; known when the device numbers them
    missed_scans: int = 0  # measured and not received; likewise


class Assembler:
    """Makes the scans of one stream, from set-up to the next."""

    def __init__(self, settings: Lms200Settings, said: Telegram, counters: Counters) -> None:
        """`said` is any answer of the device: it tells address and source of all others."""
        self.last_bad_status: int | None = None
        self.foreign = 0  # scans in a row of a shape that was not asked for
        self.is_frozen = False  # the newest scan was the one before again
        self._counters = counters
        self._address = said.address
        self._source = said.status & SOURCE
        self._mode = settings.measuring_mode
        self._unit = Unit[settings.unit.upper()]
        fans = [_Fan(sweep, settings, self._unit) for sweep in settings.sweeps]
        self._fans = {fan.header: fan for fan in fans}
        self._header_bytes = len(fans[0].header)
        self.telling_bytes = HEADER + self._header_bytes  # of a telegram, that say what it is
        self._is_telling = settings.sweeps[0].samples == 1
        self._longest = longest_range(self._mode, self._unit)
        self._gate = SpikeGate(fans[0].increment)
        self._base_from_laser = settings.mount.base_from_laser
        self._payload = b""
        self._indices = b""

    def scan(self, telegram: Telegram, arrived: float, received: float) -> Scan | None:
        """The measurement in a telegram whose first byte arrived then; None: not to be used."""
        payload = telegram.payload
        fan = self._fans.get(payload[: self._header_bytes])
        if fan is None or telegram.address != self._address or not fan.fits(payload):
            self.foreign += 1
            self._counters.unusable_scans += 1
            return None
        self.foreign = 0
        if not is_usable(telegram.status) or telegram.status & SOURCE != self._source:
            self._counters.unusable_scans += 1
            self.last_bad_status = telegram.status
            return None
        words = np.frombuffer(payload, "<u2", fan.count, self._header_bytes)
        ranges = ranges_of(words, self._mode, self._unit)
        self.is_frozen = self._is_repeated(payload, payload[fan.end : -1], ranges)
        if self.is_frozen:
            self._counters.repeated_scans += 1
            return None
        removed = self._gate.removed
        passed = self._gate.passed(ranges, arrived)
        if passed is None:
            self._counters.implausible_scans += 1
            return None
        self._counters.implausible_ranges += self._gate.removed - removed
        self._counters.scans += 1
        reflection = reflection_of(words, self._mode)
        return Scan(
            stamp=arrived - fan.age,
            received=received,
            angle_min=fan.angle_min,
            angle_increment=fan.increment,
            ranges=passed[fan.order],
            range_max=self._longest,
            beam_times=fan.beam_times,
            base_from_laser=self._base_from_laser,
            degraded=is_degraded(telegram.status),
            reflection=None if reflection is None else reflection[fan.order],
        )

    def expects(self, begun: bytes) -> bool:
        """Whether the first bytes of a telegram are those of the scan that is due."""
        payload = begun[HEADER:]
        return begun[1:2] == bytes((self._address,)) and any(map(payload.startswith, self._fans))

    def _is_repeated(self, payload: bytes, indices: bytes, ranges: Array) -> bool:
        """Whether a scan came before; counts what is missing since."""
        is_same, self._payload = payload == self._payload, payload
        before, self._indices = self._indices, indices
        if indices and before:
            scans, telegrams = (
                (now - then) % INDICES for now, then in zip(indices, before, strict=True)
            )
            if telegrams == 0:
                return True
            self._counters.lost_telegrams += telegrams - 1
            self._counters.missed_scans += max(0, scans - 1)
        if is_same and self._is_telling:
            return int(np.count_nonzero(np.isfinite(ranges))) >= TELLING
        return False


class _Fan:
    """The beams of one kind of telegram as a scan has them, and how such a telegram begins."""

    def __init__(self, sweep: Sweep, settings: Lms200Settings, unit: Unit) -> None:
        bearings, times = sweep.bearings, sweep.beam_times
        upside_down = settings.mount.upside_down
        self.order = slice(None, None, -1 if upside_down else 1)
        self.angle_min = float(-bearings[-1] if upside_down else bearings[0])
        self.increment = float(bearings[1] - bearings[0])
        self.beam_times: Array = (times - times.min())[self.order]
        self.age = sweep.age - float(times.min())  # of the first beam, at the first byte
        self.count = bearings.size
        sample = ScanTelegram(
            np.zeros(self.count, np.uint16),
            unit,
            sweep.reply,
            partial=sweep.turn is not None,
            raster=sweep.raster,
            samples=sweep.samples,
            first=sweep.first,
        ).to_payload()
        self.end = len(sample) - 1  # of the values
        self.header = sample[: self.end - 2 * self.count]

    def fits(self, payload: bytes) -> bool:
        """Whether a payload that begins so has the length, without or with indices."""
        return len(payload) - self.end in (1, 3)
