"""The Pioneer base as the daemon sees it; what happens on the line is in `session`."""

from collections.abc import Callable
from contextlib import suppress

import structlog

from followerd import clock
from followerd.errors import LinkLost, SetupError
from followerd.geometry import Pose2
from followerd.hw.interfaces import Sink
from followerd.hw.p2os.aux_exchange import PORTS, Replies
from followerd.hw.p2os.aux_link import AuxLink
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.handshake import open_servers, synchronise, take_leave
from followerd.hw.p2os.models import MODELS, Model, find
from followerd.hw.p2os.motors import MotorPower
from followerd.hw.p2os.packet_stream import PacketStream
from followerd.hw.p2os.parameters import Parameters
from followerd.hw.p2os.session import Session
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.p2os.writer import HALT, Caps
from followerd.hw.stream import Link
from followerd.hw.vcc50i.protocol import END
from followerd.hw.vcc50i.replies import SHORTEST, rest_of_answer
from followerd.messages import Chassis, Command

CANON = Replies(SHORTEST, END, rest_of_answer)
SWEEP = (9600, 38400, 19200, 115200, 57600)  # by how often they are met

__all__ = ["P2osBase", "P2osSettings"]


def _no_listener(command: Command, now: float) -> None:
    """Nobody asks when commands were sent."""


def _nobody(stream: str) -> None:
    """Nobody asks what is coming."""


class P2osBase:
    """The base on `link`. See `followerd.hw.interfaces.Base`."""

    role = "base"
    Settings = P2osSettings

    def __init__(self, settings: P2osSettings, link: Link, name: str = "base") -> None:
        self.name = name
        self.on_sent: Callable[[Command, float], None] = _no_listener
        self.on_begun: Callable[[str], None] = _nobody
        self._settings = settings
        self._link = link
        self._log = structlog.get_logger().bind(device=name)
        self._motors = MotorPower()
        self.parameters: Parameters | None = None  # of the base connected now, or last
        self._pose = Pose2()  # reached in the last session
        self._left_at: int | None = None  # baud, of a session that was left open
        self._session: Session | None = None
        self._line: PacketStream | None = None  # of the running session
        self._errors = 0  # of the sessions before

    @property
    def errors(self) -> int:
        """See CountsErrors: packets that were broken."""
        return self._errors + (0 if self._line is None else self._line.stats.rejected)

    @property
    def caps(self) -> Caps | None:
        """What the running session never exceeds; None while not connected."""
        session = self._ready()
        return None if session is None else session.writer.caps

    @property
    def chassis(self) -> Chassis | None:
        """See Base."""
        return None if self.parameters is None else self.parameters.chassis

    def aux_link(self, port: int = 1, replies: Replies = CANON) -> Link:
        """The link of a device, a Canon head by default, on AUX port 1, 2 or 3.

        What is written there waits for the base's gate, and speaks one request at a time.
        """
        if port not in PORTS:
            raise ValueError(f"a base has AUX ports 1 to 3, not {port}")
        return AuxLink(self.name, port, self._ready, replies)

    async def run(self, sink: Sink) -> None:
        """Connect and report odometry into `sink` until cancelled."""
        stream = await self._link.open(self.name, self._settings.baud)
        self._line = line = PacketStream(stream, self._settings.baud)
        lost = False
        try:
            await self._converse(line, sink)
        except LinkLost:
            lost = True
            raise
        finally:
            self._session = None
            self._errors, self._line = self.errors, None
            with suppress(LinkLost):
                if lost:
                    line.write(HALT)
                else:
                    await take_leave(line)
                    self._left_at = None
            line.close()

    def drive(self, command: Command) -> None:
        """Take over `command` at once; dropped while not connected."""
        if (session := self._ready()) is not None:
            session.writer.drive(command, clock.now())
            session.flush()

    def enable_motors(self, on: bool) -> None:
        """Ask for motors on (once the base stands) or off (at once)."""
        if not self._motors.ask(on):
            self._log.warning("motors stay off", remedy="press the MOTORS button, then arm again")
        elif self._session is not None:
            self._session.tend_motors()
            self._session.flush()

    def _ready(self) -> Session | None:
        """The running session, once it takes commands."""
        session = self._session
        return session if session is not None and session.is_ready else None

    async def _converse(self, line: PacketStream, sink: Sink) -> None:
        first = self._settings.baud
        rates = [first, *(baud for baud in SWEEP if baud != first)]
        left_at, self._left_at = self._left_at, None
        identity = await synchronise(line, rates, self.name, left_at)
        self._log.info("connected", robot=str(identity), baud=line.baud)
        model = self._model(identity)
        await open_servers(line, self.name)
        self._motors.start_session()
        session = Session(
            self.name,
            self._settings,
            line,
            identity,
            model,
            self._motors,
            self._pose,
            lambda command, now: self.on_sent(command, now),
            lambda stream: self.on_begun(stream),
        )
        self._session = session
        try:
            await clock.together(session.listen(sink), session.tend(), self._prepare(session))
        finally:
            self._pose = session.odometer.pose
            self._left_at = line.baud
            session.end()

    async def _prepare(self, session: Session) -> None:
        await session.set_up()
        self.parameters = session.parameters

    def _model(self, identity: Identity) -> Model:
        subtype = self._settings.model or identity.subclass
        model = find(subtype)
        if model is None:
            raise SetupError(
                self.name,
                f"unknown robot type {subtype!r} ({identity})",
                f"set base.model to the nearest of: {', '.join(MODELS)}",
            )
        return model
