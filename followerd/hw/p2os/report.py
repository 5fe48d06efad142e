"""From the base's packets to `Odometry`: units, pose, battery, what else was asked for."""

from dataclasses import replace
from math import nan

from followerd.hw.p2os.battery import BatteryGauge
from followerd.hw.p2os.gyro import GyroRate
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.odometer import Odometer
from followerd.hw.p2os.packet_stream import Arrived
from followerd.hw.p2os.packets import Encoders, Gyro, Io, Joystick
from followerd.hw.p2os.parameters import Parameters
from followerd.hw.p2os.sip import Flags, Sip
from followerd.messages import BaseInputs, Odometry, Sonar

NO_ECHO = 5.0  # m, how the sonar says it
ADC_TOP, ADC_VOLTS = 1023, 5.0
STICK_MIDDLE = 511.5
CHARGING = range(1, 5)  # charge states
STANDING = 5  # mm/s of each wheel, at most


class Reports:
    """One session's reports."""

    def __init__(self, model: Model, odometer: Odometer, base_id: str) -> None:
        self.odometer = odometer
        self.standing = False  # by the newest status packet
        self.motors = True  # powered, as far as the base says
        self.stop_button = False
        self._model = model
        self._base_id = base_id
        self._gyro = GyroRate()
        self._battery = BatteryGauge(nan, nan)
        self._inputs: BaseInputs | None = None

    def watch_battery(self, known: Parameters) -> None:
        """Tell the battery's level by these thresholds from now on."""
        self._battery = BatteryGauge(known.low_battery, known.shutdown)

    def add(self, extra: Gyro | Io | Encoders | Joystick) -> None:
        """Take an extended packet; the next status packet carries what it said."""
        inputs = self._inputs or BaseInputs()
        match extra:
            case Gyro():
                self._gyro.add(extra, self.standing)
            case Io(digital_in, digital_out, analog):
                volts = tuple(count * ADC_VOLTS / ADC_TOP for count in analog)
                self._inputs = replace(
                    inputs, digital_in=digital_in, digital_out=digital_out, analog=volts
                )
            case Encoders(left, right):
                self._inputs = replace(inputs, encoders=(left, right))
            case Joystick():
                self._inputs = replace(
                    inputs,
                    joystick=(extra.y / STICK_MIDDLE - 1, 1 - extra.x / STICK_MIDDLE),
                    buttons=(bool(extra.button_1), bool(extra.button_2)),
                )

    def odometry(self, sip: Sip, arrived: Arrived) -> Odometry:
        """The report of a status packet."""
        model = self._model
        self.standing = max(abs(sip.left), abs(sip.right)) <= STANDING
        if model.has_flags:
            self.motors = bool(sip.flags & Flags.MOTORS)
            self.stop_button = bool(sip.flags & Flags.STOP_BUTTON)
        return Odometry(
            stamp=arrived.stamp,
            received=arrived.received,
            pose=self.odometer.update(sip, arrived.stamp),
            twist=self.odometer.twist(sip),
            wheel_stall=(sip.stall_left, sip.stall_right),
            bumpers_front=sip.bumpers_front,
            bumpers_rear=sip.bumpers_rear,
            sonar=self._sonar(sip),
            battery=sip.volts,
            motors_enabled=self.motors,
            stop_button=self.stop_button,
            base_id=self._base_id,
            battery_level=self._battery.update(sip.volts, arrived.stamp),
            charging=sip.charge_state in CHARGING,
            gyro=self._gyro.take(),
            inputs=self._inputs,
        )

    def _sonar(self, sip: Sip) -> tuple[Sonar, ...]:
        unit = self._model.range / 1000
        return tuple(
            Sonar(disc, pose, min(reading * unit, NO_ECHO))
            for disc, reading in dict(sip.sonar).items()
            if (pose := self._model.base_from_disc(disc)) is not None
        )
