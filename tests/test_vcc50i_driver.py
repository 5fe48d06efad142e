"""The head's driver and its twin, over bytes in virtual time: it works, and it is hard to break."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import pairwise
from math import degrees, radians

import numpy as np
import pytest

from followerd import clock
from followerd.errors import DeviceError, LinkLost, OpenError, SetupError
from followerd.estimation.gaze import Gaze
from followerd.geometry import Camera
from followerd.hw.stream import ByteStream, Link
from followerd.hw.vcc50i import commands
from followerd.hw.vcc50i.commands import Cmd
from followerd.hw.vcc50i.driver import Vcc50i, Vcc50iSettings
from followerd.hw.vcc50i.protocol import Answer, Errors, FrameDecoder, Request, well_formed
from followerd.messages import Measurement, PtzState
from followerd.runtime import logs
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.line import Line, MemoryStream
from followerd.sim.twins.vcc50i import Vcc50iTwin

CAMERA = Camera.from_hfov(192, 144, radians(48))
UP = 8.0  # s until a head that was just switched on has found its home position
HARSHEST = (FaultKind.FLIP, FaultKind.WRONG)
OTHERS = (FaultKind.GARBAGE, FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.SPLIT)
DAMAGE = [*HARSHEST, *(pytest.param(kind, marks=pytest.mark.slow) for kind in OTHERS)]


@pytest.fixture(autouse=True)
def quiet() -> None:
    logs.configure("error")


class Desk:
    """A head on the desk, and its driver."""

    def __init__(
        self,
        twin: Vcc50iTwin,
        settings: Vcc50iSettings,
        *faults: Fault,
        plug: Callable[[Link], Link],
    ) -> None:
        self.twin = twin
        self.line = Line(twin, np.random.default_rng(5), "ptz", faults=faults, mend=well_formed)
        self.driver = Vcc50i(settings, plug(self.line.link))
        self.states: list[PtzState] = []
        self.error: DeviceError | None = None
        self._task: asyncio.Task[None] | None = None

    def starts(self) -> None:
        """Run the driver until it fails or is stopped."""
        self.error = None
        self._task = asyncio.get_running_loop().create_task(self._drive())

    async def stops(self) -> None:
        """Take leave."""
        assert self._task is not None
        self._task.cancel()
        with suppress(asyncio.CancelledError):
            await self._task

    async def _drive(self) -> None:
        try:
            await self.driver.run(self._take)
        except DeviceError as error:
            self.error = error

    def _take(self, measurement: Measurement) -> None:
        assert isinstance(measurement, PtzState)
        self.states.append(measurement)

    @property
    def seen(self) -> tuple[float, float]:
        """Where the picture really is: pan and tilt, degrees."""
        camera = self.twin.aimed(CAMERA, clock.now())
        return degrees(camera.yaw), degrees(camera.elevation)

    @property
    def told(self) -> tuple[float, float]:
        """Where the driver says that it is, degrees."""
        return degrees(self.states[-1].pan), degrees(self.states[-1].tilt)

    def looks(self, pan: float, tilt: float) -> None:
        """Ask for an angle, degrees."""
        self.driver.look(radians(pan), radians(tilt))

    def moved(self) -> list[Request]:
        """Commands that turned it."""
        turning = (Cmd.MOVE, Cmd.INITIALISE, Cmd.HOME, Cmd.RUN, Cmd.ZOOM)
        return [request for request in self.twin.obeyed if request.command in turning]


def play(
    story: Callable[[Desk], Awaitable[None]],
    *faults: Fault,
    settings: Vcc50iSettings | None = None,
    twin: Vcc50iTwin | None = None,
    plug: Callable[[Link], Link] = lambda link: link,
) -> Desk:
    """Run a story in virtual time."""

    async def run() -> Desk:
        head = twin or Vcc50iTwin(np.random.default_rng(4))
        desk = Desk(head, settings or Vcc50iSettings(), *faults, plug=plug)
        line = asyncio.get_running_loop().create_task(desk.line.run())
        desk.starts()
        await story(desk)
        await desk.stops()
        assert not line.done()
        line.cancel()
        return desk

    return clock.run_virtual(run())


def wrong_by(desk: Desk, truth: list[tuple[float, float]]) -> list[float]:
    """By how many degrees each state's pan differs from the truth at its stamp."""
    times, angles = zip(*truth, strict=True)
    return [
        abs(degrees(state.pan) - float(np.interp(state.stamp, times, angles)))
        for state in desk.states
        if times[0] < state.stamp < times[-1]
    ]


def fault(kind: FaultKind, start: float, length: float, share: float | None = None) -> Fault:
    return Fault("ptz", kind, start, length, share)


@pytest.mark.parametrize("is_on", [True, False])
def test_from_power_on_it_finds_home_and_reports_by_itself(is_on: bool) -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP if is_on else UP + 5)
        assert desk.told == pytest.approx((0, 0), abs=0.1)
        assert clock.now() - desk.states[-1].stamp < 0.2
        periods = [b.stamp - a.stamp for a, b in pairwise(desk.states[5:])]
        assert np.median(periods) == pytest.approx(0.05, abs=0.005)

    play(story, twin=Vcc50iTwin(np.random.default_rng(4), is_on=is_on))


@pytest.mark.parametrize(("model", "highest"), [("vc-c50i", 90), ("vc-c4", 88.9)])
def test_it_looks_where_it_is_asked_left_and_up_positive(model: str, highest: float) -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        for pan, tilt in ((40, -12), (-90, 60), (0, 0)):
            desk.looks(pan, tilt)
            await clock.sleep(2.5)
            assert desk.seen == pytest.approx((pan, tilt), abs=0.3)
            assert desk.told == pytest.approx((pan, tilt), abs=0.12)
            assert not desk.states[-1].moving
        desk.looks(200, 200)  # as far as it goes
        await clock.sleep(3.0)
        assert desk.told == pytest.approx((100, highest), abs=0.2)
        assert desk.error is None

    settings = Vcc50iSettings.model_validate({"model": model})
    play(story, settings=settings, twin=Vcc50iTwin(np.random.default_rng(4), model=model))


def test_the_newest_goal_overwrites_the_one_under_way() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(90, 0)
        await clock.sleep(0.4)
        assert desk.states[-1].moving
        desk.looks(10, 0)
        desk.looks(-30, 5)
        await clock.sleep(1.5)
        assert desk.seen == pytest.approx((-30, 5), abs=0.3)
        assert max(degrees(state.pan) for state in desk.states) < 60
        assert [r.command for r in desk.moved()][-3:] == [Cmd.MOVE, Cmd.RUN, Cmd.MOVE]

    play(story)


def test_a_goal_that_stays_is_told_once() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        for _ in range(40):
            desk.looks(25, 0)
            await clock.sleep(0.05)
        assert [r.command for r in desk.moved()].count(Cmd.MOVE) == 1

    play(story)


def test_it_zooms_and_says_so() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.driver.zoom(4)
        await clock.sleep(0.5)
        desk.driver.zoom(9)  # while it zooms
        await clock.sleep(3.0)
        assert desk.states[-1].zoom == pytest.approx(9, rel=0.01)
        assert desk.twin.aimed(CAMERA, clock.now()).fx == pytest.approx(9 * CAMERA.fx, rel=0.01)
        desk.driver.zoom(0.5)
        await clock.sleep(5.0)
        assert desk.states[-1].zoom == 1.0

    play(story)


def test_a_state_is_where_the_head_was_at_its_stamp() -> None:
    errors: list[float] = []

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        truth = []
        desk.looks(-80, 0)
        for _ in range(400):
            truth.append((clock.now(), desk.seen[0]))
            await clock.sleep(0.005)
        errors.extend(wrong_by(desk, truth))

    play(story)
    assert len(errors) > 30
    assert max(errors) < 0.4  # a step, home's half, and interpolation of the truth


def test_what_an_image_is_told_of_the_head_is_right_while_it_turns() -> None:
    """The head at image time, as it is known when the image arrives."""
    errors: list[float] = []

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        for count in range(120):
            desk.looks(60 * (-1) ** (count // 30), 0)
            stamp, true = clock.now(), desk.seen[0]
            await clock.sleep(0.020)  # readout
            gaze = Gaze()
            for state in desk.states:
                gaze.note(state)
            if (known := gaze.at(stamp)) is not None:
                errors.append(abs(degrees(known.pan) - true))
            await clock.sleep(0.0467)

    play(story)
    assert len(errors) == 120
    assert np.mean(errors) < 0.4
    assert max(errors) < 3.5  # when it starts, at 450°/s²


def test_after_a_pulled_cable_it_does_not_move_until_it_is_asked() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(80, 0)
        await clock.sleep(0.3)
        desk.line.unplug()
        await clock.sleep(0.01)
        assert isinstance(desk.error, LinkLost)
        desk.looks(-80, 0)  # dropped
        desk.starts()
        await clock.sleep(0.01)
        assert isinstance(desk.error, OpenError)
        desk.line.replug()
        desk.starts()
        moves = len(desk.moved())
        await clock.sleep(3.0)
        assert desk.told[0] == pytest.approx(80, abs=0.2)  # it ended what it was told before
        assert len(desk.moved()) == moves
        desk.looks(10, 0)
        await clock.sleep(2.0)
        assert desk.seen[0] == pytest.approx(10, abs=0.3)

    play(story)


def test_a_camera_that_lost_power_is_taken_back_and_finds_home_only_when_asked() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(-50, 0)
        await clock.sleep(2.0)
        moves = len(desk.moved())
        desk.twin.reboot(clock.now())
        while desk.error is None and clock.now() < UP + 10:
            await clock.sleep(0.1)
        silent, heard = desk.error is not None, len(desk.states)
        if silent:
            desk.starts()
        await clock.sleep(6.0)
        assert desk.seen[0] == pytest.approx(-50, abs=0.5)
        assert (len(desk.moved()), len(desk.states)) == (moves, heard)
        desk.looks(20, 0)
        await clock.sleep(8.0)
        assert desk.seen[0] == pytest.approx(20, abs=0.5)
        assert desk.told[0] == pytest.approx(20, abs=0.12)

    play(story)


def test_a_head_that_shall_not_home_at_start_waits_to_be_asked() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        assert not desk.moved()
        assert not desk.states
        desk.looks(5, 5)
        await clock.sleep(7.0)
        assert desk.told == pytest.approx((5, 5), abs=0.12)

    play(story, settings=Vcc50iSettings(home_at_start=False))


def test_a_head_that_turns_when_the_driver_starts_is_only_watched() -> None:
    twin = Vcc50iTwin(np.random.default_rng(4), is_local=False, knows_home=True)

    async def story(desk: Desk) -> None:
        await clock.sleep(0.4)
        twin.head.go(-800, 100)
        await clock.sleep(0.8)
        assert desk.states[0].moving
        await clock.sleep(3.0)
        assert desk.told == pytest.approx((90, 11.25), abs=0.12)
        assert not desk.moved()

    play(story, twin=twin)


def test_control_taken_by_the_remote_control_is_taken_back_without_a_move() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(30, 0)
        await clock.sleep(2.0)
        moves = len(desk.moved())
        desk.twin.take_by_remote()
        await clock.sleep(2.0)
        assert clock.now() - desk.states[-1].stamp < 0.2
        assert len(desk.moved()) == moves
        desk.looks(0, 0)
        await clock.sleep(2.0)
        assert desk.seen == pytest.approx((0, 0), abs=0.3)

    play(story)


def test_an_open_menu_is_named_with_its_remedy() -> None:
    twin = Vcc50iTwin(np.random.default_rng(4))
    twin.menu_is_open = True

    async def story(desk: Desk) -> None:
        await clock.sleep(1.0)
        assert isinstance(desk.error, SetupError)
        assert desk.error.remedy == "close its menu"

    play(story, twin=twin)


def test_a_silent_camera_is_a_lost_link_that_names_what_to_look_at() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(4.0)
        assert isinstance(desk.error, LinkLost)
        assert "power and cable" in desk.error.remedy

    play(story, fault(FaultKind.OFF, 0, 10))


def test_it_takes_leave_by_stopping_and_giving_control_back() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(90, 0)
        await clock.sleep(0.4)
        began = clock.now()
        await desk.stops()
        assert clock.now() - began <= 0.5
        assert desk.twin.obeyed[-1] == commands.REMOTE_CONTROL
        here = desk.seen
        await clock.sleep(1.0)
        assert desk.seen == pytest.approx(here, abs=12)
        assert desk.seen[0] < 60

    play(story)


@pytest.mark.parametrize("kind", DAMAGE)
def test_it_survives_a_bad_line_and_says_nothing_false(kind: FaultKind) -> None:
    """A fifth of the answers hurt for some time, while the head is sent to and fro."""
    errors: list[float] = []

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        truth = []
        for step in range(1600):
            if step % 400 == 0:
                desk.looks(30 * (-1) ** (step // 400), 0)
            truth.append((clock.now(), desk.seen[0]))
            await clock.sleep(0.005)
            if desk.error is not None:
                desk.starts()
        await clock.sleep(3.0)
        desk.looks(-20, 3)
        await clock.sleep(3.0)
        assert desk.told == pytest.approx((-20, 3), abs=0.12)
        assert desk.seen == pytest.approx((-20, 3), abs=0.3)
        errors.extend(wrong_by(desk, truth))
        assert [request.command for request in desk.moved()].count(Cmd.INITIALISE) == 1

    play(story, fault(kind, UP, 8, 0.2))
    assert len(errors) > 30
    assert np.percentile(errors, 95) < 0.5
    assert max(errors) < 9


@pytest.mark.slow
def test_one_percent_of_damaged_answers_for_ten_minutes_costs_no_link() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        for turn in range(120):
            desk.looks(20 * (-1) ** turn, 0)
            await clock.sleep(5.0)
            assert desk.seen[0] == pytest.approx(20 * (-1) ** turn, abs=0.3)
        assert desk.error is None

    play(story, fault(FaultKind.FLIP, UP, 600, 0.01))


class Deceiver(Vcc50iTwin):
    """Says now and then that it is somewhere else, in a perfect frame."""

    lies = 0

    def step(self, now: float) -> bytes:
        data = super().step(now)
        answer = FrameDecoder().feed(data)
        if answer and len(answer[0].body) == 12 and int(now * 1000) % 7 == 0:
            self.lies += 1
            return Answer(data=commands.position_data(500, 500)).to_bytes()
        return data


def test_a_leap_that_no_head_can_make_is_not_reported() -> None:
    twin = Deceiver(np.random.default_rng(4))

    async def story(desk: Desk) -> None:
        await clock.sleep(UP + 12)
        assert twin.lies > 10
        assert len(desk.states) > 100
        assert max(abs(state.pan) for state in desk.states) < radians(1)

    play(story, twin=twin)


class Stubborn(Vcc50iTwin):
    """Refuses one command for ever."""

    command, errors = Cmd.MOVE, Errors.PARAMETER | Errors.BUSY

    def _obey(self, request: Request, now: float) -> Answer:
        if request.command == self.command:
            return Answer(self.errors)
        return super()._obey(request, now)


def test_a_refused_move_is_given_up_and_the_next_is_tried() -> None:
    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(30, 0)
        await clock.sleep(2.0)
        assert desk.error is None
        assert clock.now() - desk.states[-1].stamp < 0.2

    play(story, twin=Stubborn(np.random.default_rng(4)))


def test_settings_that_the_camera_does_not_take_are_a_setup_error() -> None:
    twin = Stubborn(np.random.default_rng(4))
    twin.command = Cmd.TILT_SPEED

    async def story(desk: Desk) -> None:
        await clock.sleep(3.0)
        assert isinstance(desk.error, SetupError)
        assert "model" in desk.error.remedy

    play(story, twin=twin)


def test_a_camera_that_says_little_of_itself_is_driven_by_its_models_figures() -> None:
    class Terse(Vcc50iTwin):
        def _obey(self, request: Request, now: float) -> Answer:
            if request.command in (Cmd.ANGLE_LIMITS, Cmd.SPEED_LIMITS, Cmd.NAME, Cmd.ZOOM_RATIO):
                return Answer(Errors.COMMAND | Errors.BUSY)
            return super()._obey(request, now)

    async def story(desk: Desk) -> None:
        await clock.sleep(UP + 2)
        desk.looks(200, 0)
        await clock.sleep(3.0)
        assert desk.told[0] == pytest.approx(100, abs=0.1)

    play(story, twin=Terse(np.random.default_rng(4)))


def test_a_camera_that_fails_for_good_is_said_to_fail() -> None:
    twin = Stubborn(np.random.default_rng(4))
    twin.command, twin.errors = Cmd.POSITION, Errors.SYSTEM | Errors.BUSY

    async def story(desk: Desk) -> None:
        await clock.sleep(UP + 6)
        assert isinstance(desk.error, SetupError)
        assert desk.error.remedy == "switch it off and on"

    play(story, twin=twin)


def test_a_camera_that_stays_busy_is_a_lost_link() -> None:
    twin = Stubborn(np.random.default_rng(4))
    twin.command, twin.errors = Cmd.POSITION, Errors.BUSY

    async def story(desk: Desk) -> None:
        await clock.sleep(UP + 25)
        assert isinstance(desk.error, LinkLost)
        assert "busy" in desk.error.problem

    play(story, twin=twin)


def test_a_move_that_was_damaged_under_way_is_told_again() -> None:
    class Careless(Vcc50iTwin):
        missed = False

        def _obey(self, request: Request, now: float) -> Answer:
            if request.command == Cmd.MOVE and not self.missed:
                self.missed = True
                return super()._obey(commands.move(0, 50), now)
            return super()._obey(request, now)

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(30, 0)
        await clock.sleep(3.0)
        assert desk.seen == pytest.approx((30, 0), abs=0.3)

    play(story, twin=Careless(np.random.default_rng(4)))


def test_a_camera_that_does_not_switch_on_is_named_with_its_remedy() -> None:
    twin = Stubborn(np.random.default_rng(4), is_on=False)
    twin.command, twin.errors = Cmd.POWER, Errors(0)  # it says so, and does not

    async def story(desk: Desk) -> None:
        await clock.sleep(13.0)
        assert isinstance(desk.error, SetupError)
        assert desk.error.remedy == "switch it on by hand"

    play(story, twin=twin)


def test_a_head_that_does_not_find_home_is_named_with_its_remedy() -> None:
    twin = Stubborn(np.random.default_rng(4))
    twin.command, twin.errors = Cmd.INITIALISE, Errors(0)

    async def story(desk: Desk) -> None:
        await clock.sleep(23.0)
        assert isinstance(desk.error, SetupError)
        assert "turn freely" in desk.error.remedy

    play(story, twin=twin)


def test_a_camera_that_is_long_busy_with_something_else_is_waited_for() -> None:
    class Occupied(Vcc50iTwin):
        def _obey(self, request: Request, now: float) -> Answer:
            if now < 6.0 and request.command == Cmd.PAN_SPEED:
                return Answer(Errors.BUSY)
            return super()._obey(request, now)

    async def story(desk: Desk) -> None:
        await clock.sleep(UP + 6)
        assert desk.told == pytest.approx((0, 0), abs=0.1)

    play(story, twin=Occupied(np.random.default_rng(4)))


def test_a_camera_that_is_busy_for_good_cannot_be_set_up() -> None:
    twin = Stubborn(np.random.default_rng(4))
    twin.command, twin.errors = Cmd.CONTROL, Errors.BUSY

    async def story(desk: Desk) -> None:
        await clock.sleep(12.0)
        assert isinstance(desk.error, SetupError)
        assert "no control" in desk.error.problem

    play(story, twin=twin)


def test_a_damaged_status_bit_does_not_send_the_head_home() -> None:
    class Confused(Vcc50iTwin):
        def _obey(self, request: Request, now: float) -> Answer:
            answer = super()._obey(request, now)
            if request == commands.STATUS and now > UP:
                return Answer(data=b"010")  # not initialised
            return answer

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        desk.looks(20, 0)
        await clock.sleep(6.0)
        assert desk.seen == pytest.approx((20, 0), abs=0.3)
        assert [request.command for request in desk.moved()].count(Cmd.INITIALISE) == 1
        assert clock.now() - desk.states[-1].stamp < 0.3

    play(story, twin=Confused(np.random.default_rng(4)))


class Unpaced:
    """A link without a line rate, as a TCP port."""

    name = "unpaced"

    def __init__(self, link: Link) -> None:
        self._link = link

    async def open(self, device: str, baud: int) -> ByteStream:
        stream = await self._link.open(device, baud)
        assert isinstance(stream, MemoryStream)
        stream.baud = None
        return stream


def test_a_camera_behind_a_line_without_a_rate_is_understood_too() -> None:
    """Such as a simulator at a TCP port that answers in no time."""
    twin = Vcc50iTwin(np.random.default_rng(4), baud=10_000_000, answers_after=1e-4)

    async def story(desk: Desk) -> None:
        await clock.sleep(25.0)
        desk.looks(20, 0)
        await clock.sleep(4.0)
        assert desk.told == pytest.approx((20, 0), abs=0.12)

    play(story, twin=twin, plug=Unpaced)


def test_before_the_head_turns_it_is_said_to_be_about_to() -> None:
    """Who looks at images must know that the resting head's angle will not hold."""

    async def story(desk: Desk) -> None:
        await clock.sleep(UP)
        for pan in (30, -30):
            desk.looks(pan, 0)
            await clock.sleep(2.5)
        pairs = list(pairwise(desk.states))
        starts = [before for before, after in pairs if before.pan != after.pan]
        assert len(starts) > 10
        assert all(state.moving for state in starts)

    play(story)
