"""An open session with the base: three tasks that listen, tend the writer and set it up.

All bytes written here come from the writer; all stamps are those of a packet's first byte.
"""

import asyncio
from collections.abc import Callable
from math import inf

import structlog

from followerd import clock
from followerd.errors import LinkLost
from followerd.geometry import Pose2
from followerd.hw.interfaces import Sink
from followerd.hw.p2os.aux_link import AuxStream
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.motors import MotorPower
from followerd.hw.p2os.odometer import Odometer
from followerd.hw.p2os.packet_stream import Arrived, PacketStream
from followerd.hw.p2os.packets import Encoders, Gyro, Io, Joystick, ResetNote, SerAux, parse
from followerd.hw.p2os.parameters import Parameters
from followerd.hw.p2os.plausible import is_plausible
from followerd.hw.p2os.report import Reports
from followerd.hw.p2os.set_up import SetUp
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.p2os.sip import TYPES as SIP_TYPES
from followerd.hw.p2os.sip import Sip
from followerd.hw.p2os.writer import Status, Writer
from followerd.messages import BatteryLevel, Command

SILENCE = 0.35  # s without a status packet: the link is lost (two lost packets alone are no stop)
POLL = 0.001  # s, shortest sleep of the writer's task
IDLE = 0.5  # s, longest sleep of the writer's task

Sent = Callable[[Command, float], None]


class Session:
    """What is known and running while the base is connected."""

    def __init__(
        self,
        name: str,
        settings: P2osSettings,
        line: PacketStream,
        identity: Identity,
        model: Model,
        motors: MotorPower,
        pose: Pose2,
        on_sent: Sent,
        on_begun: Callable[[str], None],
    ) -> None:
        self.odometer = Odometer(model, pose)
        self.writer = Writer(line.baud)
        self.aux: dict[int, AuxStream] = {}
        self._name = name
        self._line = line
        self._model = model
        self._motors = motors
        self._set_up = SetUp(name, settings, identity, model, line, self.writer, self.flush)
        self._reports = Reports(model, self.odometer, str(identity))
        self._log = structlog.get_logger().bind(device=name)
        self._tail: int | None = None  # of this firmware's status packets
        self._odd_tail: int | None = None  # of the newest one
        self._battery = BatteryLevel.UNKNOWN
        self._heard = clock.now()  # s, newest status packet
        self._on_sent = on_sent
        self._on_begun = on_begun
        self._told_of = -1  # place of the last status packet whose beginning was told
        self._wake = asyncio.Event()
        self._asleep_until = 0.0
        self._lost: LinkLost | None = None

    @property
    def is_ready(self) -> bool:
        """Whether commands are taken."""
        return self._set_up.is_done

    @property
    def parameters(self) -> Parameters:
        """What is known of the base so far."""
        return self._set_up.parameters

    async def set_up(self) -> None:
        """Prepare the base; then commands are taken."""
        await self._set_up.run()
        self._reports.watch_battery(self.parameters)

    # Reading

    async def listen(self, sink: Sink) -> None:
        """Read packets for ever; raises LinkLost on silence and on a controller reset."""
        while True:
            arrivals = await clock.within(self._patience(), self._line.read())
            if arrivals is None and self._patience() <= 0:
                # when the loop was blocked, bytes may be waiting although the time is up
                arrivals = await clock.within(0.0, self._line.read())
                if arrivals is None:
                    raise self._silence()
            for arrived in arrivals or ():
                self._take(arrived, sink)
            self._herald()

    def _herald(self) -> None:
        """Say once of each status packet that it has begun."""
        begun = self._line.begun
        if begun is not None and begun[0] in SIP_TYPES and begun[1] != self._told_of:
            self._told_of = begun[1]
            self._on_begun("odometry")

    def _silence(self) -> LinkLost:
        return LinkLost(
            self._name,
            f"silent for {SILENCE} s; its own watchdog stops it {self.parameters.watchdog:g} s"
            " after the last command",
            "check the cable and the robot's power",
        )

    def _patience(self) -> float:
        """For how long silence is no fault yet, s."""
        return max(self._heard + SILENCE, self._set_up.excused_until) - clock.now()

    def _take(self, arrived: Arrived, sink: Sink) -> None:
        match parse(arrived.packet.payload):
            case Sip() as sip:
                self._take_status(sip, arrived, sink)
            case Gyro() | Io() | Encoders() | Joystick() as extra:
                self._reports.add(extra)
            case SerAux(port, data) if data and port in self.aux:
                self.aux[port].take(data, arrived.received)
            case Config() as config:
                self._set_up.take_config(config, arrived)
            case ResetNote():
                raise LinkLost(self._name, "its controller was reset", "arm again when it is back")

    def _take_status(self, sip: Sip, arrived: Arrived, sink: Sink) -> None:
        if not self._is_same_firmware(sip.tail) or not is_plausible(sip, self._model):
            return  # as good as silence
        jumps = self.odometer.jumps
        if not self.odometer.follows(sip, arrived.stamp):
            return
        if self.odometer.jumps > jumps:
            self._log.warning("counters jumped; the pose goes on from where it was")
        self._heard = arrived.received
        self._set_up.statuses += 1
        report = self._reports.odometry(sip, arrived)
        if self._model.has_flags:
            self._motors.note(report.motors_enabled, report.stop_button)
        self.writer.note(
            Status(
                stamp=arrived.stamp,
                heading=self.odometer.heading(sip),
                standing=self._reports.standing,
                motors=report.motors_enabled,
            )
        )
        self._watch_battery(report.battery_level, report.battery)
        sink(report)
        for stream in list(self.aux.values()):
            stream.tend()
        self.tend_motors()
        self.flush()

    def _watch_battery(self, level: BatteryLevel, volts: float) -> None:
        if level is self._battery:
            return
        self._battery = level
        if level in (BatteryLevel.GOOD, BatteryLevel.UNKNOWN):
            self._log.info("battery", state=level.value, volts=round(volts, 1))
        else:
            self._log.warning(
                "battery", state=level.value, volts=round(volts, 1), remedy="charge the base"
            )

    def _is_same_firmware(self, tail: int) -> bool:
        """Whether a status packet ends as all others do; a new end counts when it comes twice."""
        if self._tail is None or tail == self._odd_tail:
            self._tail = tail
        self._odd_tail = tail
        return tail == self._tail

    # Writing

    async def tend(self) -> None:
        """Write what falls due by time, for ever; raises LinkLost when a write failed."""
        while True:
            self._asleep_until = -inf  # nobody need wake it
            self.flush()
            if self._lost is not None:
                raise self._lost
            now = clock.now()
            rest = min(max(self.writer.wake_at(now) - now, POLL), IDLE)
            self._asleep_until = now + rest
            await clock.within(rest, self._wake.wait())
            self._wake.clear()

    def flush(self) -> None:
        """Write what is due now."""
        now = clock.now()
        data = self.writer.due(now)
        if data:
            try:
                self._line.write(data)
            except LinkLost as lost:
                self._lost = lost
                self._wake.set()
                return
        if self.writer.served is not None:
            self._on_sent(self.writer.served, clock.now())
        if self.writer.wake_at(now) < self._asleep_until:
            self._wake.set()

    def relay(self, packet: bytes) -> None:
        """Queue commands for an AUX port behind the gate."""
        self.writer.relay(packet)
        self.flush()

    @property
    def relayed_backlog(self) -> int:
        """Bytes for AUX ports that still wait for the gate."""
        return self.writer.relayed_backlog

    def end(self) -> None:
        """The base is gone, and what hangs on it."""
        for stream in list(self.aux.values()):
            stream.lose(f"the link to {self._name} is lost")

    def tend_motors(self) -> None:
        """Switch the motors as wished, as long as packets do not show it."""
        wish = self._motors.due(clock.now(), self.writer.is_settled)
        if wish is None:
            return
        if wish:
            self.writer.motors_on()
        else:
            self.writer.motors_off()
        if not self._model.has_flags:
            self._motors.note(wish, stop_button=False)
