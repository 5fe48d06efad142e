"""Preparing a base whose servers are open: flash parameters, limits, line rate, extra packets.

Nothing is asked before the writer knows that the robot stands with zero setpoints.
"""

from collections.abc import Callable
from math import degrees

import structlog

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.p2os.commands import BAUDS, Cmd
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.models import Model
from followerd.hw.p2os.packet_stream import Arrived, PacketStream
from followerd.hw.p2os.parameters import Parameters, parameters
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.p2os.writer import Caps, Writer

SETTLING = 5.0  # s for a robot to come to rest before set-up goes on
CONFIG_TRIES, CONFIG_WAIT = 4, 0.3  # s
AUTOBAUD = 2
RAW_GYRO = 1  # HasGyro: the client gets its samples
SWITCHING = 0.03  # s between the request for a new line rate and its use
RATE_TRIES, RATE_WAIT = 4, 0.1  # s
FALL_BACK = 0.6  # s until a robot that heard nothing is back at its flash rate
POLL = 0.01  # s
SELDOM = 0.115  # s between status packets; beyond, two lost ones are already silence
STREAM = 2  # argument that asks for a packet each cycle
EXTRAS = {
    "gyro": (Cmd.GYRO, 1),
    "encoders": (Cmd.ENCODER, STREAM),
    "io": (Cmd.IOREQUEST, STREAM),
    "joystick": (Cmd.JOYREQUEST, STREAM),
}


class SetUp:
    """One session's preparation, once; it writes through `writer` and `flush` only."""

    def __init__(
        self,
        name: str,
        settings: P2osSettings,
        identity: Identity,
        model: Model,
        line: PacketStream,
        writer: Writer,
        flush: Callable[[], None],
    ) -> None:
        self.is_done = False
        self.statuses = 0  # status packets so far; the session counts them
        self.excused_until = 0.0  # s, silence is no fault before
        self._name = name
        self._settings = settings
        self._identity = identity
        self._model = model
        self._line = line
        self._writer = writer
        self._flush = flush
        self._log = structlog.get_logger().bind(device=name)
        self._config: Config | None = None
        self._doubtful = b""  # a CONFIGpac with a wrong checksum
        self._learn()

    def take_config(self, config: Config, arrived: Arrived) -> None:
        """Believe it when its checksum is right, or when it comes twice the same."""
        payload = arrived.packet.payload
        if config.is_believable and (arrived.packet.is_intact or payload == self._doubtful):
            self._config = config
        self._doubtful = payload

    async def run(self) -> None:
        """Prepare the base; raises SetupError when it does not come to rest."""
        if not await self._until(lambda: self._writer.is_settled, SETTLING):
            raise SetupError(self._name, "does not come to rest", "lift the wheels, look after it")
        await self._read_config()
        self._learn()
        self._warn()
        self._ask_for_limits()
        await self._raise_baud()
        self._ask_for_limits()  # nothing acknowledges them: a lost one must not matter
        self._ask_for_extras()
        await self._until(lambda: self._writer.is_idle, SETTLING)
        self.is_done = True

    def _learn(self) -> None:
        """What the flash parameters, as far as they are read, say of the base."""
        known = parameters(self._identity, self._model, self._config, self._settings)
        self.parameters: Parameters = known
        self._writer.caps = Caps(known.speed, known.turn, self._model.vel2_step / 1000)

    def _warn(self) -> None:
        known = self.parameters
        if known.speed < self._settings.max_speed_mps:
            self._log.warning(
                "slower than configured",
                speed=round(known.speed, 2),
                watchdog=known.watchdog,
                remedy="shorten WatchDog with the vendor's flash tool, or raise blind_distance_m",
            )
        if known.deceleration < self._settings.deceleration_mps2:
            self._log.warning("brakes less than configured", deceleration=known.deceleration)
        if known.cycle > SELDOM:
            self._log.warning(
                "reports so seldom that one lost packet stops it",
                cycle=known.cycle,
                remedy="set SipCycle to 100 with the vendor's flash tool",
            )

    def _ask_for_limits(self) -> None:
        known = self.parameters
        for number, value in (
            (Cmd.SONAR, int(self._settings.sonar)),
            (Cmd.SETV, 1000 * known.speed),
            (Cmd.SETA, 1000 * known.acceleration),
            (Cmd.SETA, -1000 * known.deceleration),
            (Cmd.SETRV, degrees(known.turn)),
            (Cmd.SETRA, degrees(known.turn_acceleration)),
            (Cmd.SETRA, -degrees(known.turn_deceleration)),
        ):
            self._writer.ask(number, round(value))

    def _ask_for_extras(self) -> None:
        for extra in self._settings.extra_packets:
            if extra == "gyro" and self._config and self._config.has_gyro != RAW_GYRO:
                why = "its controller uses the gyro itself" if self._config.has_gyro else "has none"
                self._log.warning("no gyro packets", why=why)
                continue
            self._writer.ask(*EXTRAS[extra])

    async def _read_config(self) -> None:
        for _ in range(CONFIG_TRIES):
            self._writer.ask(Cmd.CONFIG)
            self._flush()
            if await self._until(lambda: self._config is not None, CONFIG_WAIT):
                return
        self._log.warning("tells no flash parameters", assumed_watchdog=self.parameters.watchdog)

    async def _raise_baud(self) -> None:
        slow, fast = self._line.baud, self._settings.raised_baud
        can = self._config is not None and self._config.auto_baud == AUTOBAUD
        if not can or fast is None or fast <= slow:
            return
        self._writer.ask(Cmd.HOSTBAUD, BAUDS.index(fast))
        await self._until(lambda: self._writer.is_idle, SETTLING)
        await self._line.drain()
        # no packet can come through meanwhile
        self.excused_until = clock.now() + SWITCHING + RATE_TRIES * RATE_WAIT + FALL_BACK
        await clock.sleep(SWITCHING)
        self._line.set_baud(fast)
        before = self.statuses
        for _ in range(RATE_TRIES):
            self._writer.ask(Cmd.STOP)  # any valid command confirms the rate
            self._flush()
            if await self._until(lambda: self.statuses > before, RATE_WAIT):
                self.excused_until = 0.0
                self._writer.set_baud(fast)
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
