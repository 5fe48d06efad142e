"""What the config says about a laser."""

from math import radians
from typing import Literal

from pydantic import Field, model_validator

from followerd.geometry import Pose2
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import Mode, Reply
from followerd.hw.lms200.variant import VARIANTS, Variant, line_time
from followerd.settings import Settings

MISSED = 2.3  # periods without a scan: two are missing, not one that is a little late
UNSEEN = 1.5  # periods without one, when not even the beginning of another is seen on a slow line
SLOW_LINE = 0.05  # s, line time of a telegram from which its beginning is looked for
LEAST_SECTOR = 10  # deg
LEAST_STALE = 0.2  # s; a busy computer may hold up the fast scans of 500000 baud by more


class Mount(Settings):
    """Where the scanner sits on the robot."""

    x_m: float = Field(0.02, ge=-2, le=2, description="forward of the robot's centre")
    y_m: float = Field(0.0, ge=-2, le=2, description="left of the robot's centre")
    yaw_deg: float = Field(0.0, ge=-180, le=180, description="turned to the left")
    upside_down: bool = False

    @property
    def base_from_laser(self) -> Pose2:
        """The mount as a transform."""
        return Pose2(self.x_m, self.y_m, radians(self.yaw_deg))


class Lms200Settings(Settings):
    """A SICK LMS200 on a serial line."""

    baud: Literal[9600, 19200, 38400, 500000] = Field(
        500000, description="line rate to stream at; 500000 needs an RS-422 adapter"
    )
    field_deg: Literal[100, 180] = 180
    resolution_deg: float = Field(0.5, description="0.25 (field of 100 degrees only), 0.5 or 1")
    unit: Literal["mm", "cm"] = Field("mm", description="mm: up to 8 m; cm: up to 80 m")
    measuring_mode: Literal[0, 1, 2, 3, 4, 5, 6, 15] = Field(
        0,
        description="0 to 2: 8 m (80 m in cm), 3 and 4: 16 m, 5, 6 and 15: 32 m; 1, 3 and 5 tell"
        " reflectors, 0 tells dazzle",
    )
    stream: Literal["scans", "turns", "means"] = Field(
        "scans", description="whole scans; each turn of the mirror by itself; means of some scans"
    )
    mean_of: int = Field(2, ge=2, le=250, description="scans in a mean")
    sector_deg: tuple[float, float] | None = Field(
        None, description="send only what lies between these bearings, e.g. [-60, 60]"
    )
    number_scans: bool | None = Field(
        None,
        description="the device numbers its scans, and lost ones are counted; unset: as it is",
    )
    mount: Mount = Mount()

    @model_validator(mode="after")
    def _has_variant(self) -> "Lms200Settings":
        if self.variant not in VARIANTS:
            known = ", ".join(f"{v.field}/{v.resolution / 100:g}" for v in VARIANTS)
            raise ValueError(
                f"an LMS200 has no field_deg {self.field_deg} with resolution_deg"
                f" {self.resolution_deg:g}; it has {known}"
            )
        return self

    @model_validator(mode="after")
    def _has_sector(self) -> "Lms200Settings":
        if self.sector_deg is None:
            return self
        right, left = self.sector_deg
        if not -self.field_deg / 2 <= right < left <= self.field_deg / 2:
            raise ValueError(
                f"sector_deg: expected [right, left] within the {self.field_deg} degrees"
            )
        if left - right < LEAST_SECTOR:
            raise ValueError(f"sector_deg: at least {LEAST_SECTOR} degrees")
        if self.stream == "turns":
            raise ValueError("sector_deg: the device sends turns whole; set `stream: scans`")
        return self

    @property
    def variant(self) -> Variant:
        """Field and resolution as the device names them."""
        return Variant(self.field_deg, round(self.resolution_deg * 100))

    @property
    def sweeps(self) -> tuple[Sweep, ...]:
        """What the telegrams of the stream hold, in turn."""
        variant, samples = self.variant, self.mean_of if self.stream == "means" else 1
        if self.stream == "turns":
            return tuple(Sweep(variant, turn=turn) for turn in range(variant.rotations))
        if self.sector_deg is None:
            return (Sweep(variant, Reply.MEAN if samples > 1 else Reply.SCAN, samples=samples),)
        # the device's own bearings: mounted upside down, its right is the robot's left
        side = -1 if self.mount.upside_down else 1
        right, left = sorted(side * degrees for degrees in self.sector_deg)
        first, last = (
            1 + round((degrees + self.field_deg / 2) / self.resolution_deg)
            for degrees in (right, left)
        )
        reply = Reply.MEAN_SUBRANGE if samples > 1 else Reply.SUBRANGE
        return (Sweep(variant, reply, samples=samples, first=first, last=last),)

    @property
    def stream_mode(self) -> bytes:
        """The operating mode that streams them, with its parameters."""
        if self.stream == "turns":
            return bytes((Mode.STREAM_PARTIAL,))
        (sweep,) = self.sweeps
        numbers = sweep.first.to_bytes(2, "little") + (sweep.last or 0).to_bytes(2, "little")
        match sweep.reply:
            case Reply.MEAN:
                return bytes((Mode.STREAM_MEAN, sweep.samples))
            case Reply.SUBRANGE:
                return bytes((Mode.STREAM_SUBRANGE,)) + numbers
            case Reply.MEAN_SUBRANGE:
                return bytes((Mode.STREAM_MEAN_SUBRANGE, sweep.samples)) + numbers
            case _:
                return bytes((Mode.STREAM,))


def oldest(settings: Lms200Settings) -> float:
    """Age in s of a scan's first beam when the next scan is complete: what a stop reckons."""
    return _age_when_complete(settings) + delivered_period(settings)


def stale_after(settings: Lms200Settings) -> float:
    """Age in s of the first beam at which two scans in a row are missing.

    On a slow line that is known early, when the second has not even begun to come.
    """
    missed = UNSEEN if _is_slow(settings) else MISSED
    return max(_age_when_complete(settings) + missed * delivered_period(settings), LEAST_STALE)


def under_way(settings: Lms200Settings) -> float:
    """Seconds beyond `stale_after` that a scan which is seen to come is waited for."""
    if not _is_slow(settings):
        return 0.0
    longest = _age_when_complete(settings) + MISSED * delivered_period(settings)
    return longest - stale_after(settings)


def delivered_period(settings: Lms200Settings) -> float:
    """Seconds between the scans that arrive, whatever the mirror measures meanwhile."""
    return settings.sweeps[0].delivered_period(settings.baud)


def _is_slow(settings: Lms200Settings) -> bool:
    return line_time(settings.sweeps[0].telegram_bytes, settings.baud) > SLOW_LINE


def _age_when_complete(settings: Lms200Settings) -> float:
    sweep = settings.sweeps[0]
    age = sweep.age - float(sweep.beam_times.min())
    return age + line_time(sweep.telegram_bytes, settings.baud)
