"""What is known of a connected base: its type, its flash parameters, and our limits for it."""

from dataclasses import dataclass
from math import nan, radians

from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.settings import P2osSettings
from followerd.messages import Chassis

WATCHDOG = 2.0  # s, of the firmware, where it does not say
VOLTS = (5.0, 60.0)  # V, of any robot's battery
CYCLE = 0.1  # s between status packets, where it does not say


@dataclass(frozen=True, slots=True)
class Parameters:
    """A base, as far as driving it safely depends on it; nan where nothing is known."""

    identity: Identity
    serial: str
    firmware: str
    track: float  # m, effective, between the wheels
    front: float  # m, from the axle's middle
    rear: float  # m
    half_width: float  # m
    speed: float  # m/s, never exceeded
    turn: float  # rad/s, never exceeded
    acceleration: float  # m/s², of the base's own ramps
    deceleration: float  # m/s²
    turn_acceleration: float  # rad/s²
    turn_deceleration: float  # rad/s²
    watchdog: float  # s, after which the base stops a silent client
    watchdog_is_read: bool  # else assumed
    cycle: float  # s between status packets
    low_battery: float  # V
    shutdown: float  # V, at which the base switches itself off

    @property
    def chassis(self) -> Chassis:
        """What the guard must know of it."""
        return Chassis(
            self.front,
            self.rear,
            self.half_width,
            self.track,
            self.deceleration,
            self.turn_deceleration,
            self.watchdog,
        )


def parameters(
    identity: Identity, model: Model, config: Config | None, settings: P2osSettings
) -> Parameters:
    """From the base's type, its flash as far as it was read, and the user's settings."""
    flash = config or Config()
    watchdog = flash.watchdog / 1000 or WATCHDOG
    blind = settings.blind_distance_m / watchdog
    speed_top = _least(flash.trans_vel_top, model.speed_max) / 1000
    turn_top = _least(flash.rot_vel_top, model.turn_max)
    ramp_top, turn_ramp_top = flash.trans_acc_top / 1000, flash.rot_acc_top
    return Parameters(
        identity=identity,
        serial=flash.serial,
        firmware=flash.firmware,
        track=2 * model.half_track,
        front=model.front / 1000,
        rear=model.rear / 1000,
        half_width=model.width / 2000,
        speed=min(settings.max_speed_mps, blind, speed_top),
        turn=radians(min(settings.max_turn_dps, turn_top)),
        acceleration=_least(ramp_top, settings.acceleration_mps2),
        deceleration=_least(ramp_top, settings.deceleration_mps2),
        turn_acceleration=radians(_least(turn_ramp_top, settings.turn_acceleration_dps2)),
        turn_deceleration=radians(_least(turn_ramp_top, settings.turn_deceleration_dps2)),
        watchdog=watchdog,
        watchdog_is_read=flash.watchdog > 0,
        cycle=flash.sip_cycle / 1000 or CYCLE,
        low_battery=settings.low_battery_v or _volts(flash.low_battery),
        shutdown=settings.shutdown_v or _volts(flash.shutdown_volts),
    )


def _least(flash: float, other: float) -> float:
    """The lower of both; 0 in the flash says nothing."""
    return min(flash, other) if flash else other


def _volts(decivolts: int) -> float:
    """nan for what no battery of a robot has."""
    return decivolts / 10 if VOLTS[0] <= decivolts / 10 <= VOLTS[1] else nan
