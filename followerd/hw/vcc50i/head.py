"""A camera that obeys, in one session: what it was asked for, where it is, what to tell it next."""

import structlog

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.interfaces import Sink
from followerd.hw.vcc50i.chase import Chase
from followerd.hw.vcc50i.chase import Goal as Moving
from followerd.hw.vcc50i.commands import (
    LEFTWARD,
    POSITION,
    POSITION_DIGITS,
    RIGHTWARD,
    STEP,
    STOP,
    STOP_ZOOM,
    TURNING,
    ZOOM_DIGITS,
    ZOOM_POSITION,
    Status,
    move,
    pan_angle,
    pan_speed,
    pan_steps,
    position_of,
    tilt_angle,
    tilt_steps,
    zoom,
    zoom_factor,
    zoom_position,
)
from followerd.hw.vcc50i.gate import PositionGate
from followerd.hw.vcc50i.models import Limits
from followerd.hw.vcc50i.protocol import Request, number
from followerd.hw.vcc50i.pursuit import Goal, Pursuit
from followerd.hw.vcc50i.session import Busy, Refused, Session, WrongMode
from followerd.hw.vcc50i.wake import find_home, status_of
from followerd.messages import PtzState

NEAR, REACHED, SLACK = 9, 2, 9  # steps (1°, 0.2°, 1°)
ZOOM_REACHED = ZOOM_SLACK = 98  # zoom positions; the manual allows 5 %
ZOOM_SPEED = 4000  # zoom positions/s that no lens reaches
STATUS_PERIOD, ZOOM_PERIOD = 0.5, 5.0  # s, how often a resting camera is asked
BUSY_TOO_LONG = 20.0  # s

log = structlog.get_logger()


class Head:
    """Asks and tells over an open session whose camera was woken and set up."""

    def __init__(
        self, session: Session, limits: Limits, speeds: tuple[int, int], device: str
    ) -> None:
        self.moves = False
        self._session = session
        self._limits = limits
        self._device = device
        self._turn = Pursuit(NEAR, REACHED)
        self._lens = Pursuit(0, ZOOM_REACHED)
        self._chase = Chase(speeds[0], limits.pan)
        self._pan_speed = self._speed_told = speeds[0]  # steps/s
        self._gate = PositionGate((limits.pan, limits.tilt), speeds, SLACK)
        self._lens_gate = PositionGate(((0, limits.zoom_tele),), (ZOOM_SPEED,), ZOOM_SLACK)
        self._knows_home = False
        self._zooms = False
        self._status_due = self._zoom_due = clock.now()
        self._free_at = clock.now()  # s, when it last did what it was told
        self._at: tuple[int, int] | None = None
        self._zoom: int | None = None

    def look(self, pan: float, tilt: float, rate: float | None = None) -> None:
        """Turn to `pan`, `tilt` (rad), or as far as it goes; keep pace with a goal of a `rate`."""
        aims = zip(
            (pan_steps(pan), tilt_steps(tilt)), (self._limits.pan, self._limits.tilt), strict=True
        )
        goal = tuple(min(max(aim, low), high) for aim, (low, high) in aims)
        self._chase.goal = None
        if rate is None or self._at is None or abs(goal[1] - self._at[1]) > NEAR:
            self._turn.want(goal)
            return
        self._turn.give_up()
        self._chase.goal = Moving(goal[0], -rate / STEP, clock.now())

    def zoom(self, factor: float) -> None:
        """Zoom to `factor` times the widest focal length."""
        self._lens.want((zoom_position(factor, self._limits.zoom_tele, self._limits.zoom_ratio),))

    async def cycle(self, sink: Sink, *, homes: bool) -> bool:
        """Say where it points, then tell it what was asked for; whether that was of use.

        A head that does not know its home position finds it first, if anything was asked for, or
        if it `homes` unasked. Raises WrongMode and LinkLost.
        """
        try:
            if clock.now() >= self._status_due and not self.moves:
                await self._ask_status()
            if not self._knows_home:
                if homes or self._turn.wanted is not None:
                    await find_home(self._session, self._device)
                    self._gate.forget()
                    self._status_due = clock.now()
                return False
            if (stamp := await self._measure()) is None:
                return False
            await self._act(stamp, sink)
        except Busy as reason:
            self._status_due, self.moves = clock.now(), False
            if clock.now() - self._free_at > BUSY_TOO_LONG:
                raise LinkLost(
                    self._device, "the camera stays busy", "switch it off and on"
                ) from reason
            return False
        self._free_at = clock.now()
        return True

    async def stop(self) -> None:
        """Stop turning and zooming."""
        for request in (STOP, STOP_ZOOM):
            await self._session.tell(request)

    # Asking

    async def _ask_status(self) -> None:
        status = await status_of(self._session)
        self._status_due = clock.now() + STATUS_PERIOD
        self._knows_home = not status & Status.NOT_INITIALISED or await self._tells_position()
        if self._zooms and not status & Status.ZOOMING:
            self._zoom_due = clock.now()
        self._zooms = bool(status & Status.ZOOMING)
        self.moves = bool(status & TURNING)
        if not self.moves:
            self._turn.rest()

    async def _tells_position(self) -> bool:
        """Whether it knows its home position; the status bit alone may be a damaged digit.

        A camera that has forgotten it was off: that raises WrongMode, and it is set up anew.
        """
        try:
            await self._session.ask(POSITION, POSITION_DIGITS)
        except WrongMode:
            if self._knows_home:
                raise
            return False
        return True

    async def _measure(self) -> float | None:
        """Ask for the angles; the stamp is when the camera had heard the question."""
        position = position_of(await self._session.ask(POSITION, POSITION_DIGITS))
        stamp = self._session.asked
        if position is None or not self._gate.passes(position, stamp, self._goals()):
            return None
        if self._at is not None and position != self._at:
            self.moves = True
        elif self.moves:  # it seems to rest: does it say so?
            await self._ask_status()
        self._at = position
        if self._zooms or self._zoom is None or (clock.now() >= self._zoom_due and not self.moves):
            await self._measure_zoom()
        return None if self._zoom is None else stamp

    async def _measure_zoom(self) -> None:
        position = number(await self._session.ask(ZOOM_POSITION, ZOOM_DIGITS))
        goals = self._lens.told or ([] if self._zoom is None else [(self._zoom,)])
        if position is None or not self._lens_gate.passes((position,), self._session.asked, goals):
            return
        self._zoom_due = clock.now() + ZOOM_PERIOD
        if position == self._zoom and self._zooms:  # it seems to rest: does it say so?
            await self._ask_status()
        self._zoom = position

    def _goals(self) -> list[Goal]:
        """What it may be on its way to; a resting head stays, a moving one goes anywhere."""
        if self._chase.goal is not None or self._chase.told:
            return []
        return self._turn.told or ([] if self.moves or self._at is None else [self._at])

    # Telling

    async def _act(self, stamp: float, sink: Sink) -> None:
        """Report, and tell the goal that is due; the report says already that it will move."""
        if self._at is None or self._zoom is None:
            return
        moved, goal = self.moves, self._turn.due(self._at, moves=self.moves)
        self.moves = moved or goal is not None
        sink(self._state(self._at, self._zoom, stamp))
        if self._chase.goal is not None:
            await self._keep_pace(self._at[0], stamp)
        elif goal is not None:
            await self._end_chase()
            if moved:
                await self._session.tell(STOP)
            await self._tell(self._turn, goal, move(*goal), STOP)
        if zoomed := self._lens.due((self._zoom,), moves=self._zooms):
            await self._tell(self._lens, zoomed, zoom(*zoomed), STOP_ZOOM)
            self._zooms = True

    async def _keep_pace(self, pan: int, stamp: float) -> None:
        chase = self._chase
        speed = chase.speed(pan, stamp, clock.now())
        if not chase.is_news(speed):
            return
        if chase.turns_back(speed):  # at the speed it had: it has to brake first, anyway
            speed = -chase.told
        turns = speed * chase.told <= 0
        if turns and self.moves:
            await self._session.tell(STOP)
            chase.told = 0
        if speed:
            await self._set_speed(abs(speed))
        if speed and turns:
            run = RIGHTWARD if speed > 0 else LEFTWARD
            try:
                await self._session.tell(run)
            except Busy:
                await self._session.tell(STOP)
                await self._session.tell(run)
            self.moves = True
        chase.told = speed

    async def _end_chase(self) -> None:
        self._chase.told = 0
        await self._set_speed(self._pan_speed)

    async def _set_speed(self, steps: int) -> None:
        if steps != self._speed_told:
            await self._session.tell(pan_speed(steps))
            self._speed_told = steps

    async def _tell(self, pursuit: Pursuit, goal: Goal, request: Request, stop: Request) -> None:
        """Tell it a goal; while it still goes for another, stop it first."""
        try:
            try:
                await self._session.tell(request)
            except Busy:
                await self._session.tell(stop)
                await self._session.tell(request)
        except (Busy, WrongMode):
            raise
        except Refused as reason:
            log.warning("camera refuses", device=self._device, problem=str(reason))
            pursuit.give_up()
            return
        pursuit.tell(goal)

    def _state(self, at: tuple[int, int], lens: int, stamp: float) -> PtzState:
        factor = zoom_factor(lens, self._limits.zoom_tele, self._limits.zoom_ratio)
        return PtzState(stamp, pan_angle(at[0]), tilt_angle(at[1]), factor, self.moves)
