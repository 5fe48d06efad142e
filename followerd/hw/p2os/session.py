"""An open session with the base: three tasks that listen, tend the writer and set it up.

All bytes written here come from the writer; all stamps are those of a packet's first byte.
"""

import asyncio
from collections.abc import Callable
from math import degrees, radians

import structlog

from followerd import clock
from followerd.errors import LinkLost, SetupError
from followerd.geometry import Pose2
from followerd.hw.interfaces import Sink
from followerd.hw.p2os.commands import BAUDS, Cmd
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.motors import MotorPower
from followerd.hw.p2os.odometer import Odometer
from followerd.hw.p2os.packet_stream import Arrived, PacketStream
from followerd.hw.p2os.packets import ResetNote, parse
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.p2os.sip import Flags, Sip
from followerd.hw.p2os.writer import Caps, Status, Writer
from followerd.messages import Command, Odometry, Sonar

SILENCE = 0.35  # s without a status packet: the link is lost (two lost packets alone are no stop)
WATCHDOG = 2.0  # s, of the firmware, where it does not say
STANDING = 5  # mm/s of each wheel, at most
ABSURD = 2  # × the robot's top speed: no wheel turns so fast
NO_ECHO = 5.0  # m, how the sonar says it
SETTLING = 5.0  # s for a robot to come to rest before set-up goes on
CONFIG_TRIES, CONFIG_WAIT = 4, 0.3  # s
AUTOBAUD = 2
SWITCHING = 0.03  # s between the request for a new line rate and its use
RATE_TRIES, RATE_WAIT = 4, 0.1  # s
FALL_BACK = 0.6  # s until a robot that heard nothing is back at its flash rate
POLL = 0.01  # s
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
    ) -> None:
        self.is_ready = False
        self.odometer = Odometer(model, pose)
        self.config: Config | None = None
        self._name = name
        self._settings = settings
        self._line = line
        self._identity = identity
        self._model = model
        self._motors = motors
        self.writer = Writer(self._caps(), line.baud)
        self._log = structlog.get_logger().bind(device=name)
        self._doubtful = b""  # a CONFIGpac with a wrong checksum
        self._heard = clock.now()  # s, newest status packet
        self._excused_until = 0.0  # s, silence is no fault before
        self._statuses = 0
        self._on_sent = on_sent
        self._wake = asyncio.Event()
        self._asleep_until = 0.0
        self._lost: LinkLost | None = None

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

    def _silence(self) -> LinkLost:
        return LinkLost(
            self._name,
            f"silent for {SILENCE} s; its own watchdog stops it {self._watchdog:g} s after the"
            " last command",
            "check the cable and the robot's power",
        )

    def _patience(self) -> float:
        """For how long silence is no fault yet, s."""
        return max(self._heard + SILENCE, self._excused_until) - clock.now()

    def _take(self, arrived: Arrived, sink: Sink) -> None:
        match parse(arrived.packet.payload):
            case Sip() as sip:
                self._take_status(sip, arrived, sink)
            case Config() as config:
                self._take_config(config, arrived)
            case ResetNote():
                raise LinkLost(self._name, "its controller was reset", "arm again when it is back")

    def _take_status(self, sip: Sip, arrived: Arrived, sink: Sink) -> None:
        fastest = max(abs(sip.left), abs(sip.right))
        if fastest * self._model.velocity > ABSURD * self._model.speed_max:
            return  # as good as silence
        self._heard = arrived.received
        self._statuses += 1
        motors, stop_button = True, False
        if self._model.has_flags:
            motors = bool(sip.flags & Flags.MOTORS)
            stop_button = bool(sip.flags & Flags.STOP_BUTTON)
            self._motors.note(motors, stop_button)
        jumps = self.odometer.jumps
        pose = self.odometer.update(sip, arrived.stamp)
        if self.odometer.jumps > jumps:
            self._log.warning("counters jumped; the pose goes on from where it was")
        self.writer.note(
            Status(
                stamp=arrived.stamp,
                heading=self.odometer.heading(sip),
                standing=fastest <= STANDING,
                motors=motors,
            )
        )
        sink(
            Odometry(
                stamp=arrived.stamp,
                received=arrived.received,
                pose=pose,
                twist=self.odometer.twist(sip),
                wheel_stall=(sip.stall_left, sip.stall_right),
                bumpers_front=sip.bumpers_front,
                bumpers_rear=sip.bumpers_rear,
                sonar=self._sonar(sip),
                battery=sip.volts,
                motors_enabled=motors,
                stop_button=stop_button,
                base_id=str(self._identity),
            )
        )
        self.tend_motors()
        self.flush()

    def _sonar(self, sip: Sip) -> tuple[Sonar, ...]:
        unit = self._model.range / 1000
        return tuple(
            Sonar(disc, pose, min(reading * unit, NO_ECHO))
            for disc, reading in dict(sip.sonar).items()
            if (pose := self._model.base_from_disc(disc)) is not None
        )

    def _take_config(self, config: Config, arrived: Arrived) -> None:
        """Believe it when its checksum is right, or when it comes twice the same."""
        payload = arrived.packet.payload
        if config.is_believable and (arrived.packet.is_intact or payload == self._doubtful):
            self.config = config
        self._doubtful = payload

    # Writing

    async def tend(self) -> None:
        """Write what falls due by time, for ever; raises LinkLost when a write failed."""
        while True:
            self.flush()
            if self._lost is not None:
                raise self._lost
            now = clock.now()
            rest = min(max(self.writer.wake_at(now) - now, POLL / 10), IDLE)
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

    # Setting up

    async def set_up(self) -> None:
        """Read the flash parameters, set limits, raise the line rate; then commands are taken."""
        if not await self._until(lambda: self.writer.is_settled, SETTLING):
            raise SetupError(self._name, "does not come to rest", "lift the wheels, look after it")
        await self._read_config()
        self.writer.caps = self._caps()
        settings, caps = self._settings, self.writer.caps
        for number, value in (
            (Cmd.SONAR, int(settings.sonar)),
            (Cmd.SETV, 1000 * caps.speed),
            (Cmd.SETA, 1000 * settings.acceleration_mps2),
            (Cmd.SETA, -1000 * settings.deceleration_mps2),
            (Cmd.SETRV, degrees(caps.turn)),
            (Cmd.SETRA, settings.turn_acceleration_dps2),
            (Cmd.SETRA, -settings.turn_deceleration_dps2),
        ):
            self.writer.ask(number, round(value))
        await self._raise_baud()
        self.is_ready = True
        if caps.speed < settings.max_speed_mps:
            self._log.warning(
                "slower than configured",
                speed=round(caps.speed, 2),
                watchdog=self._watchdog,
                remedy="shorten WatchDog with the vendor's flash tool, or raise blind_distance_m",
            )

    @property
    def _watchdog(self) -> float:
        """The firmware's, s."""
        return WATCHDOG if self.config is None else self.config.watchdog / 1000

    def _caps(self) -> Caps:
        settings, model = self._settings, self._model
        speeds = [settings.max_speed_mps, model.speed_max / 1000]
        speeds.append(settings.blind_distance_m / self._watchdog)
        turns = [settings.max_turn_dps, model.turn_max]
        if self.config is not None:
            speeds.append(self.config.trans_vel_top / 1000)
            turns.append(self.config.rot_vel_top)
        return Caps(min(speeds), radians(min(turns)), model.vel2_step / 1000)

    async def _read_config(self) -> None:
        for _ in range(CONFIG_TRIES):
            self.writer.ask(Cmd.CONFIG)
            self.flush()
            if await self._until(lambda: self.config is not None, CONFIG_WAIT):
                return
        self._log.warning("tells no flash parameters", assumed_watchdog=WATCHDOG)

    async def _raise_baud(self) -> None:
        slow, fast = self._line.baud, self._settings.raised_baud
        can = self.config is not None and self.config.auto_baud == AUTOBAUD
        if not can or fast is None or fast <= slow:
            return
        self.writer.ask(Cmd.HOSTBAUD, BAUDS.index(fast))
        await self._until(lambda: self.writer.is_idle, SETTLING)
        await self._line.drain()
        # no packet can come through meanwhile
        self._excused_until = clock.now() + SWITCHING + RATE_TRIES * RATE_WAIT + FALL_BACK
        await clock.sleep(SWITCHING)
        self._line.set_baud(fast)
        before = self._statuses
        for _ in range(RATE_TRIES):
            self.writer.ask(Cmd.STOP)  # any valid command confirms the rate
            self.flush()
            if await self._until(lambda: self._statuses > before, RATE_WAIT):
                self._excused_until = 0.0
                self.writer.set_baud(fast)
                self._log.info("line rate raised", baud=fast)
                return
        self._line.set_baud(slow)
        await clock.sleep(FALL_BACK)

    async def _until(self, holds: Callable[[], bool], seconds: float) -> bool:
        """Wait until `holds`; False when it takes too long."""
        deadline = clock.now() + seconds
        while not holds():
            if clock.now() >= deadline:
                return False
            await clock.sleep(POLL)
        return True
