"""The running daemon: devices in, decisions out. Everything that looks on is a watcher."""

from collections.abc import Callable, Sequence

import structlog

from followerd import clock
from followerd.control.novelty import Novelty
from followerd.control.transitions import Action
from followerd.errors import UsageError
from followerd.estimation.gaze import Gaze
from followerd.events import Coming, Event, Late, Operator, Tick
from followerd.hw.interfaces import Base, CountsErrors, ExposureLock, Herald, PanTilt, Sensor
from followerd.messages import (
    Box,
    Chassis,
    Decision,
    Fault,
    Image,
    LookAt,
    Measurement,
    PtzState,
    Scan,
    TrackState,
)
from followerd.pipeline import Pipeline
from followerd.record.journal import Entry, Taken
from followerd.runtime.overheard import Hear
from followerd.runtime.pointing import Pointing
from followerd.runtime.pressure import Pressure
from followerd.runtime.scanning import Scanning
from followerd.runtime.shadows import Shadows
from followerd.runtime.stats import Stats
from followerd.runtime.supervisor import supervise
from followerd.runtime.vision import Vision
from followerd.trackers.interfaces import Tracker
from followerd.trackers.looking import Looking
from followerd.trackers.sweeping import Sweeping

EARLY = 0.001  # s that a timer may fire before its time
STUCK = 3  # repetitions in a row that are worth a word
MISSED = 0.6  # share of a stream's limit from which a measurement was missed
LATE = 0.2  # s that the loop may be held up
TICK = 0.05  # s without any event after which staleness is looked at

log = structlog.get_logger()


class Daemon:
    """One base, its sensors, one tracker, one pipeline; lives in the event loop."""

    def __init__(
        self,
        base: Base,
        sensors: Sequence[Sensor],
        tracker: Tracker,
        pipeline: Pipeline,
        image_work: float,
        head: PanTilt | None = None,
        shadows: Shadows | None = None,
        *,
        heads: bool = False,
    ) -> None:
        """`heads`: the tracker wants the head, not the body."""
        self.base = base
        self.head = head
        self.shadows = shadows
        self.sensors = (*sensors, head) if head else sensors
        self.pipeline = pipeline
        by_scans = "scan" in tracker.needs
        sweeping = Sweeping(tracker, pipeline.ego_at) if by_scans else None
        self.scanning = (
            None if sweeping is None else Scanning(sweeping, self.handle, self._consumed)
        )
        looking = Looking(None if by_scans else tracker, pipeline.ego_at, pipeline.place_at)
        self.vision = Vision(looking, self.handle, self._consumed, image_work)
        self.pointing = Pointing(pipeline.ego_at, heads=heads)
        self.stats = Stats(began=clock.now())
        self.pressure = Pressure(self.stats)
        self.decision: Decision | None = None
        self.decision_watchers: list[Callable[[Decision], None]] = []
        self.journal_watchers: list[Callable[[Entry], None]] = []
        self.line_watchers: list[Hear] = []  # of the devices' bytes, where the config wants them
        self.measurement_watchers: list[Callable[[Measurement], None]] = [
            self.stats.measured,
            self.pointing.measured,
        ]
        if shadows is not None:
            self.decision_watchers.append(shadows.note)
        self._novelty = Novelty()
        self._gaze = Gaze()
        self._chassis: Chassis | None = None
        self._motors = False
        self._look: LookAt | None = None
        base.on_sent = self.stats.sent
        for device in (base, *sensors):
            if isinstance(device, Herald):
                device.on_begun = self._coming

    async def run(self) -> None:
        """Run until cancelled or until a device proves unusable (DeviceError)."""
        sensors = (self.base, *self.sensors)
        devices = [supervise(sensor, self.take, self.handle) for sensor in sensors]
        beside = [] if self.shadows is None else [self.shadows.run()]
        try:
            own = self.vision.run(), self._tick()
            watching = self.stats.watch_lag(), self.pressure.watch()
            await clock.together(*devices, *own, *watching, *beside)
        finally:
            self.stats.finish(clock.now())

    def errors(self) -> dict[str, int]:
        """How often something came broken or not at all, by device; see CountsErrors."""
        devices = (self.base, *self.sensors)
        return {each.name: each.errors for each in devices if isinstance(each, CountsErrors)}

    def take(self, measurement: Measurement) -> None:
        """A device measured something.

        An image of which nobody knows where the camera's head pointed is not looked at: the robot
        stops as when there is none.
        """
        aimed: Measurement | None = measurement
        if isinstance(measurement, Image) and self.head is not None:
            aimed = self._gaze.aimed(measurement)
        if isinstance(measurement, Image) and self.pressure.why:
            self.stats.measured(measurement)
        else:
            for watch in self.measurement_watchers:
                watch(aimed or measurement)
        if not self._is_new(measurement):
            return
        if isinstance(aimed, Image):
            self.vision.offer(aimed)
        elif isinstance(aimed, PtzState):
            self._gaze.note(aimed)
        elif aimed is not None:
            self._measure_base()
            self.handle(aimed)
            if self.scanning is not None and isinstance(aimed, Scan):
                self.scanning.take(aimed, self.pipeline.pose)

    def _coming(self, stream: str) -> None:
        """A measurement has begun to come; that matters only when the one before was missed."""
        fresh, now = self.pipeline.freshness, clock.now()
        missed = now - fresh.newest[stream] > MISSED * fresh.stale_after[stream]
        if missed and not self._novelty.repeated.get(stream):
            self.handle(Coming(stream))

    def _measure_base(self) -> None:
        """Once the base has told its dimensions the guard must know them."""
        if self.base.chassis is not None and self.base.chassis != self._chassis:
            self._chassis = self.base.chassis
            self.handle(self._chassis)

    def _is_new(self, measurement: Measurement) -> bool:
        """What a stuck device repeats is not used: the robot stops as when it says nothing."""
        wish = None if self.decision is None else self.decision.command.motion
        if self._novelty.is_new(measurement, wish, clock.now()):
            return True
        kind = type(measurement).__name__.lower()
        if self._novelty.repeated[kind] == STUCK:
            log.warning("a device repeats itself", measurement=kind)
        return False

    def handle(self, event: Event) -> Decision:
        """One event through the pipeline, and its command to the base."""
        now = clock.now()
        if self.journal_watchers:
            self._consumed(Taken(now, event))
        if isinstance(event, Fault):
            self.stats.faulted(event)
        decision = self.pipeline.step(event, now)
        if decision.motors is not self._motors:
            self._motors = decision.motors
            self.base.enable_motors(decision.motors)
        self.stats.decided(decision)  # before it is sent, so that a stop is timed
        self.base.drive(decision.command)
        self._turn_head(decision.look)
        if self.decision is None or decision.mode is not self.decision.mode:
            reasons = [str(reason) for reason in decision.reasons]
            log.info("mode", mode=decision.mode.value, reasons=reasons)
        self.decision = decision
        for watch in self.decision_watchers:
            watch(decision)
        return decision

    async def enrol(
        self, region: Box | tuple[float, float], frame_id: int | None = None
    ) -> TrackState:
        """Enrol a person; he must be confirmed before arming. Raises UsageError.

        A point for a tracker of scans is in m, in `base`, unless `frame_id` says in which picture.
        """
        refused = self.handle(Operator(Action.ENROL)).refused
        if refused:
            raise UsageError(refused)
        if self.scanning is None:
            image = self.vision.frame(frame_id)
            meant = self.pointing.meant(image, region)
            state = await self.vision.enrol(meant, image.id)
        else:
            in_picture = isinstance(region, Box) or frame_id is not None
            clicked = self.vision.frame(frame_id) if in_picture else None
            state = self.scanning.enrol(region, clicked)
        self._lock_exposure(True)
        where = state.position if state.box is None else state.box
        log.info("enrolled", at=where, confidence=round(state.confidence, 2))
        return state

    def act(self, action: Action, session: str = "") -> str:
        """An operator's action; returns why it was refused, or an empty string."""
        decision = self.handle(Operator(action, session))
        if action in (Action.ARM, Action.DISARM) and not decision.refused:
            self._lock_exposure(action is Action.ARM)
        log.info("operator", action=action.value, refused=decision.refused or None)
        return decision.refused

    def _consumed(self, entry: Entry) -> None:
        for watch in self.journal_watchers:
            watch(entry)

    def _turn_head(self, look: LookAt | None) -> None:
        """Only what is new: a head that is told again would be stopped for it."""
        if self.head is not None and look is not None and look != self._look:
            self.head.look(look.pan, look.tilt, look.rate)
        self._look = look

    def _lock_exposure(self, locked: bool) -> None:
        """The person's colours must stay as they were learned."""
        for sensor in self.sensors:
            if isinstance(sensor, ExposureLock):
                sensor.lock_exposure(locked)

    async def _tick(self) -> None:
        while True:
            due = TICK + (self.decision.stamp if self.decision else self.stats.began)
            if clock.now() < due - EARLY:
                await clock.sleep_until(due)
                if (late := clock.now() - due) > LATE:
                    log.warning("the loop was late", seconds=round(late, 3))
                    self.handle(Late(late))
            else:
                self.handle(Tick())
