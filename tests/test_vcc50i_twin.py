"""The simulated camera head behaves as Canon's manual says."""

from math import degrees, radians

import numpy as np
import pytest

from followerd.geometry import Camera
from followerd.hw.vcc50i import commands
from followerd.hw.vcc50i.commands import Cmd, Status
from followerd.hw.vcc50i.protocol import Answer, Errors, FrameDecoder, Request, number
from followerd.sim.twins.vcc50i import ANSWERS_AFTER, POWERS_UP, STARTS, Vcc50iTwin
from tests.test_vcc50i_protocol import TRANSCRIPT, client_requests

BUSY = Errors.BUSY
MODE = Errors.MODE | Errors.BUSY
PARAMETER = Errors.PARAMETER | Errors.BUSY
OK = Errors(0)


class Bench:
    """A twin and a patient host."""

    def __init__(self, twin: Vcc50iTwin) -> None:
        self.twin = twin
        self.now = 0.0
        self._decoder = FrameDecoder()

    def asks(self, request: Request) -> Answer:
        """The answer; the time it takes passes."""
        self.twin.receive(request.to_bytes(), self.now)
        self.now = self.twin.wake_at()
        (frame,) = self._decoder.feed(self.twin.step(self.now))
        answer = Answer.parse(frame)
        assert answer is not None
        return answer

    def tells(self, *requests: Request) -> None:
        """Commands that are obeyed."""
        for request in requests:
            assert self.asks(request).errors == OK, request

    def passes(self, seconds: float) -> None:
        """Time."""
        self.now += seconds

    @property
    def status(self) -> Status:
        """All bits."""
        return Status(number(self.asks(Request(Cmd.STATUS, b"0")).data) or 0)

    @property
    def position(self) -> tuple[int, int] | None:
        """Steps."""
        return commands.position_of(self.asks(commands.POSITION).data)

    @property
    def seen(self) -> tuple[float, float]:
        """Pan and tilt of the picture, degrees."""
        camera = self.twin.aimed(Camera.from_hfov(192, 144, radians(48)), self.now)
        return degrees(camera.yaw), degrees(camera.elevation)


def bench(*, is_on: bool = True) -> Bench:
    """A twin whose mains were just switched on."""
    return Bench(Vcc50iTwin(np.random.default_rng(3), is_on=is_on))


def ready() -> Bench:
    """A twin under control that knows where it points and may tilt as far as it can."""
    at = bench()
    at.tells(commands.HOST_CONTROL, commands.INITIALISE)
    at.passes(6.0)
    at.tells(commands.tilt_range(-267, 800))
    return at


def test_after_power_on_it_is_under_local_control_and_knows_no_position() -> None:
    at = bench()
    assert at.status == Status.LOCAL | Status.NOT_INITIALISED
    assert at.asks(commands.POSITION).errors == MODE
    assert at.asks(commands.INITIALISE).errors == MODE
    at.tells(commands.HOST_CONTROL)
    assert at.status == Status.NOT_INITIALISED
    assert at.asks(commands.POSITION).errors == MODE


def test_a_move_before_it_knows_home_is_refused_and_yet_moves_it() -> None:
    at = bench()
    at.tells(commands.HOST_CONTROL)
    assert at.asks(commands.move(10, 10)).errors == MODE
    assert at.status & commands.TURNING
    assert at.asks(commands.POSITION).errors == BUSY
    at.passes(6.0)
    assert at.status == Status(0)


def test_finding_home_takes_some_seconds_and_cannot_be_stopped() -> None:
    at = bench()
    at.tells(commands.HOST_CONTROL, commands.INITIALISE)
    assert at.asks(commands.STOP).errors == BUSY
    at.passes(2.0)
    assert at.status & commands.TURNING
    at.passes(3.0)
    assert at.status == Status(0)
    assert at.position == (0, 0)
    assert at.seen == pytest.approx((0.0, 0.0), abs=0.3)
    assert at.seen != (0.0, 0.0)  # it finds home to half a step


def test_the_picture_turns_left_when_the_camera_is_told_a_negative_pan() -> None:
    at = ready()
    at.tells(commands.move(-267, 89))
    at.passes(1.5)
    assert at.position == (-267, 89)
    assert at.seen == pytest.approx((30.04, 10.01), abs=0.3)


def test_half_a_turn_takes_two_seconds_and_is_reported_on_the_way() -> None:
    at = ready()
    at.tells(commands.move(800, 0))
    at.passes(3.0)
    at.tells(commands.move(-800, 0))
    at.passes(1.0)
    assert at.position is not None
    assert abs(at.position[0]) < 200
    assert at.status & Status.PANNING
    at.passes(1.25)
    assert at.position == (-800, 0)
    assert at.status == Status(0)


def test_it_turns_at_the_speed_that_was_set() -> None:
    at = ready()
    at.tells(commands.pan_speed(80), commands.move(160, 0))
    at.passes(1.0)
    assert at.position is not None
    assert 70 < at.position[0] < 90
    at.tells(commands.pan_speed(800))  # even while it turns
    at.passes(0.3)
    assert at.position == (160, 0)


def test_a_move_under_way_makes_it_busy_until_it_is_stopped() -> None:
    at = ready()
    at.tells(commands.move(800, 0))
    assert at.asks(commands.move(0, 0)).errors == BUSY
    at.tells(commands.STOP, commands.move(-100, 0))
    at.passes(1.0)
    assert at.position == (-100, 0)


@pytest.mark.parametrize(
    "request_",
    [
        commands.move(900, 0),
        commands.move(0, -300),
        commands.tilt_range(100, 0),
        commands.tilt_range(-300, 0),
        commands.pan_speed(801),
        commands.tilt_speed(7),
        commands.zoom(1961),
        Request(Cmd.MOVE, b"8000"),
        Request(Cmd.RUN, b"9"),
    ],
    ids=str,
)
def test_what_is_beyond_its_limits_is_a_parameter_error(request_: Request) -> None:
    assert ready().asks(request_).errors == PARAMETER


def test_it_tilts_by_thirty_degrees_only_until_told_more() -> None:
    at = bench()
    at.tells(commands.HOST_CONTROL, commands.INITIALISE)
    at.passes(6.0)
    assert at.asks(commands.move(0, 400)).errors == PARAMETER
    at.tells(commands.tilt_range(-267, 800), commands.move(0, 400))


def test_it_runs_to_its_end_when_told_no_goal() -> None:
    at = ready()
    for which, end in ((b"1", (889, 0)), (b"2", (-889, 0)), (b"3", (-889, 800))):
        at.tells(Request(Cmd.RUN, which))
        assert at.asks(Request(Cmd.HOME)).errors == BUSY
        at.passes(4.0)
        assert at.position == end
    at.tells(Request(Cmd.HOME))
    at.passes(4.0)
    assert at.position == (0, 0)


def test_zooming_takes_time_and_narrows_the_view() -> None:
    at = ready()
    at.tells(commands.zoom(980))
    assert at.asks(commands.zoom(100)).errors == BUSY
    assert at.status & Status.ZOOMING
    at.passes(3.0)
    assert at.asks(commands.ZOOM_POSITION).data == b"03D4"
    wide = Camera.from_hfov(192, 144, radians(48))
    assert at.twin.aimed(wide, at.now).fx == pytest.approx(wide.fx * 26**0.5)
    at.tells(commands.zoom(0), commands.STOP_ZOOM)
    at.passes(3.0)
    assert number(at.asks(commands.ZOOM_POSITION).data) not in (0, 980)


def test_switching_it_on_takes_seconds() -> None:
    at = bench(is_on=False)
    at.tells(commands.HOST_CONTROL)
    assert at.asks(commands.INITIALISE).errors == MODE
    at.tells(commands.POWER_ON)
    assert at.asks(commands.POWER_ON).errors == BUSY
    at.passes(POWERS_UP)
    assert at.status == Status.NOT_INITIALISED
    at.tells(commands.POWER_OFF)
    assert at.status & Status.CAMERA_OFF


def test_an_open_menu_keeps_the_host_out() -> None:
    at = bench()
    at.twin.menu_is_open = True
    assert at.asks(commands.HOST_CONTROL).errors == MODE


def test_it_says_what_it_is_and_can() -> None:
    at = ready()
    for request, data in (
        (Request(Cmd.NAME), b"C50i "),
        (Request(Cmd.SPEED_LIMITS, b"3"), b"26E"),
        (Request(Cmd.SPEED, b"0"), b"320"),
        (Request(Cmd.ANGLE_LIMITS, b"0"), b"7C87"),
        (Request(Cmd.ANGLE_LIMITS, b"3"), b"8320"),
        (Request(Cmd.ZOOM_POSITION, b"3"), b"07A8"),
        (Request(Cmd.ZOOM_RATIO), b"1A"),
    ):
        assert at.asks(request) == Answer(data=data)
    assert at.asks(Request(0x41)).errors == Errors.COMMAND | BUSY


def test_a_command_that_comes_before_the_answer_to_the_last_is_lost() -> None:
    at = ready()
    at.twin.receive(commands.STATUS.to_bytes() + commands.move(100, 0).to_bytes(), at.now)
    assert at.twin.wake_at() == pytest.approx(at.now + ANSWERS_AFTER)
    at.now = at.twin.wake_at()
    assert at.twin.step(at.now)
    at.passes(1.0)
    assert at.position == (0, 0)


def test_without_power_it_stands_where_it_is_and_forgets_the_rest() -> None:
    at = ready()
    at.tells(commands.move(-600, 200))
    at.passes(0.4)
    at.twin.reboot(at.now)
    seen = at.seen
    assert 20 < seen[0] < 50
    at.twin.receive(commands.STATUS.to_bytes(), at.now + STARTS / 2)
    assert at.twin.wake_at() == float("inf")
    at.passes(STARTS)
    assert at.status == Status.LOCAL | Status.NOT_INITIALISED
    assert at.seen == seen


def test_it_carries_an_independent_client_through_its_set_up() -> None:
    if not TRANSCRIPT.exists():
        pytest.skip(f"needs {TRANSCRIPT.name}, captured from an independent client")
    at = bench()
    for request in client_requests():
        while (answer := at.asks(request)).errors & BUSY:  # it repeats what was not obeyed
            assert not answer.errors & Errors.PARAMETER
            assert at.now < 20
            at.passes(0.3)
            if answer.errors & Errors.MODE:
                at.tells(commands.HOST_CONTROL)
    at.passes(2.0)
    assert at.position == (267, -89)
