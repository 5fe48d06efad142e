"""The Canon VC-C50i and VC-C4 as the daemon sees them; what is said on the line is in `head`."""

import asyncio
from contextlib import suppress

import structlog

from followerd import clock
from followerd.errors import DeviceError, SetupError
from followerd.hw.interfaces import Sink
from followerd.hw.stream import Link
from followerd.hw.vcc50i.commands import REMOTE_CONTROL
from followerd.hw.vcc50i.head import Head
from followerd.hw.vcc50i.session import Refused, Session
from followerd.hw.vcc50i.settings import Vcc50iSettings
from followerd.hw.vcc50i.wake import configure, limits_of, name_of, wake

SETBACKS = 3  # times in a row that it refuses what it must do
LEAVE = 0.45  # s

log = structlog.get_logger()

__all__ = ["Vcc50i", "Vcc50iSettings"]


class Vcc50i:
    """The head on `link`. See `followerd.hw.interfaces.PanTilt`."""

    role = "ptz"
    Settings = Vcc50iSettings

    def __init__(self, settings: Vcc50iSettings, link: Link, name: str = "ptz") -> None:
        self.name = name
        self._settings = settings
        self._link = link
        self._head: Head | None = None
        self._homes = settings.home_at_start  # unasked, until it has worked once
        self._asked = asyncio.Event()
        self.errors = 0  # see CountsErrors: what it refused

    def look(self, pan: float, tilt: float, rate: float | None = None) -> None:
        """See hw.interfaces.PanTilt."""
        if self._head is not None:
            self._head.look(pan, tilt, rate)
            self._asked.set()

    def zoom(self, factor: float) -> None:
        """Zoom to `factor` times the widest focal length; dropped while not connected."""
        if self._head is not None:
            self._head.zoom(factor)
            self._asked.set()

    async def run(self, sink: Sink) -> None:
        """See hw.interfaces.Sensor. After a reconnection the head rests until it is asked."""
        stream = await self._link.open(self.name, self._settings.baud)
        session = Session(stream, self._settings.baud, self.name)
        try:
            await self._serve(session, sink)
        except asyncio.CancelledError:
            with suppress(DeviceError, Refused):
                await clock.within(LEAVE, self._take_leave(session))
            raise
        finally:
            self._head = None
            stream.close()

    async def _serve(self, session: Session, sink: Sink) -> None:
        setbacks = 0
        while True:
            try:
                self._head = await self._set_up(session)
                while True:
                    began = clock.now()
                    if await self._head.cycle(sink, homes=self._homes):
                        self._homes, setbacks = False, 0
                    await self._rest(began)
            except Refused as reason:
                self._head = None
                setbacks += 1
                self.errors += 1
                log.warning("camera does not obey", device=self.name, problem=str(reason))
                if setbacks >= SETBACKS:
                    raise SetupError(
                        self.name, f"the camera does not obey: {reason}", "switch it off and on"
                    ) from reason

    async def _set_up(self, session: Session) -> Head:
        await wake(session, self.name)
        name = await name_of(session)
        limits = await limits_of(session, self._settings)
        speeds = await configure(session, self._settings, limits, self.name)
        log.info("camera set up", device=self.name, model=name)
        return Head(session, limits, speeds, self.name)

    async def _rest(self, began: float) -> None:
        """Until the next question is due, or somebody asks for something."""
        rest = began + 1.0 / self._settings.rate_hz - clock.now()
        await clock.within(max(0.0, rest), self._asked.wait())
        self._asked.clear()

    async def _take_leave(self, session: Session) -> None:
        """Stop, and give control back to the remote control."""
        await session.settle()
        if self._head is not None and self._head.moves:
            await self._head.stop()
        await session.tell(REMOTE_CONTROL)
