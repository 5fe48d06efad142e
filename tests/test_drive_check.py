"""`followerd drive-check`: a good robot passes, whatever is wrong with one is found and named."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from followerd import clock
from followerd.__main__ import call
from followerd.control.stand import StandGuard
from followerd.geometry import Pose2
from followerd.hw.lms200.driver import Lms200
from followerd.hw.lms200.settings import Lms200Settings
from followerd.hw.p2os.commands import Cmd
from followerd.hw.p2os.config import Identity
from followerd.hw.p2os.driver import P2osBase
from followerd.hw.p2os.models import MODELS
from followerd.hw.p2os.parameters import parameters
from followerd.hw.p2os.settings import P2osSettings
from followerd.hw.p2os.writer import HALT
from followerd.messages import Odometry, StopReason, Twist
from followerd.pytest_plugin import Simulation
from followerd.resources import shipped
from followerd.runtime.cut_link import CutLink
from followerd.runtime.drive_check import DriveCheck
from followerd.runtime.standing_checks import Check, Outcome, reports
from followerd.sim.line import Line
from tests import lms200_bench
from tests.p2os_bench import RecordingTwin
from tests.p2os_body import FloorBody

ALL = [
    "session", "reports", "battery", "bumpers", "sonar", "laser", "laser's mount", "motors on",
    "forward", "forward, by eye", "stop", "left", "left, by eye", "no commands",
    "firmware's watchdog", "button", "motors off",
]  # fmt: skip


@dataclass
class Robot:
    """A base and a laser on a stand, and a person beside them."""

    twin: RecordingTwin
    body: FloorBody
    questions: list[str] = field(default_factory=list)
    no_to: str = "nothing"  # a word of the question that is answered with no
    presses: bool = True
    settings: P2osSettings = field(default_factory=P2osSettings)
    room: float = 3.0  # m, what the laser sees
    unplug_at: float | None = None  # s

    async def ask(self, question: str) -> bool:
        self.questions.append(question)
        await clock.sleep(1.0)
        if "press the MOTORS" in question and self.presses:
            self.twin.press_motors_button()
        return self.no_to not in question

    async def checked(self) -> dict[str, Check]:
        rng = np.random.default_rng(3)
        robot = Line(self.twin, rng, "robot")
        laser = Line(lms200_bench.twin(lms200_bench.Round(self.room)), rng, "laser")
        pumps = [asyncio.create_task(line.run()) for line in (robot, laser)]
        if self.unplug_at is not None:
            asyncio.get_running_loop().call_later(self.unplug_at, robot.unplug)
        link = CutLink(robot.link, HALT)
        base = P2osBase(self.settings, link)
        scanner = Lms200(Lms200Settings(baud=9600, resolution_deg=1), laser.link)
        told: list[Check] = []
        checks = await DriveCheck(base, scanner, link, self.ask, told.append).run()
        assert checks == told
        rolled = self.body.rolled
        await clock.sleep(5.0)
        assert self.body.is_still
        assert self.body.rolled == rolled
        for pump in pumps:
            pump.cancel()
        return {check.name: check for check in checks}


def robot(*, body: FloorBody | None = None, **options: Any) -> Robot:
    body = body or FloorBody()
    return Robot(RecordingTwin(body, np.random.default_rng(1), **options), body)


def checks_of(on_a_stand: Robot) -> dict[str, Check]:
    checks = clock.run_virtual(on_a_stand.checked())
    assert all((c.outcome is Outcome.FAILED) == bool(c.remedy) for c in checks.values())
    return checks


def failed(checks: dict[str, Check]) -> list[str]:
    return [name for name, check in checks.items() if check.outcome is Outcome.FAILED]


def test_a_good_robot_passes_every_check_and_hardly_moves() -> None:
    it = robot()
    checks = checks_of(it)
    assert list(checks) == ALL
    assert failed(checks) == []
    assert {c.outcome for c in checks.values()} == {Outcome.OK}
    assert "followerd_twin / Pioneer / p3dx-sh" in checks["session"].detail
    assert "a second, 0% lost" in checks["reports"].detail
    assert "at 0.10 m/s" in checks["stop"].detail
    assert "its flash says 2.0 s" in checks["firmware's watchdog"].detail
    assert it.body.rolled < 1.5
    assert not it.twin.is_connected


@pytest.mark.slow
@pytest.mark.parametrize("model", ["p2dx", "p3at-sh", "amigo-sh", "pion1m", "powerbot-sh"])
def test_other_robots_pass_too(model: str) -> None:
    it = robot(model=model, body=FloorBody(MODELS[model].half_track))
    checks = checks_of(it)
    assert failed(checks) == [], checks
    for name in ("button", "motors off"):  # an early P2OS does not tell
        assert (checks[name].outcome is Outcome.OK) == MODELS[model].has_flags


def test_the_watchdog_is_measured_and_nothing_goes_on_when_the_wire_is_whole_again() -> None:
    it = robot(watchdog=1.0)
    detail = checks_of(it)["firmware's watchdog"].detail
    assert detail.startswith("stands 1."), detail
    last = max(i for i, order in enumerate(it.twin.heard) if order == (Cmd.RVEL, -20))
    assert it.twin.heard[last + 1] == (Cmd.STOP, None)
    assert it.twin.heard_at[last + 1] - it.twin.heard_at[last] > 1.0


def wrong(told: Callable[[Robot], None], **options: Any) -> Robot:
    it = robot(**options)
    told(it)
    return it


def press_stop(it: Robot) -> None:
    it.twin.press_stop_button(True)


def press_bumper(it: Robot) -> None:
    it.body.bumpers = (0b100, 0)


def hold_wheels(it: Robot) -> None:
    it.body.blocked = (True, True)


def drain(it: Robot) -> None:
    it.twin.status.battery = 10.6


def say_no(word: str) -> Callable[[Robot], None]:
    def told(it: Robot) -> None:
        it.no_to = word

    return told


def set_field(**fields: Any) -> Callable[[Robot], None]:
    def told(it: Robot) -> None:
        for name, value in fields.items():
            setattr(it, name, value)

    return told


@pytest.mark.parametrize(
    ("it", "name", "says"),
    [
        (wrong(drain), "battery", "10.6 V"),
        (wrong(press_bumper), "bumpers", "front bumper 3"),
        (wrong(hold_wheels), "forward", "wheel stalled"),
        (wrong(press_stop), "bumpers", "the STOP button is pressed"),
        (wrong(set_field(room=60.0)), "laser", "0 of 181 beams see"),
        pytest.param(
            wrong(say_no("nearest thing")), "laser's mount", "not so", marks=pytest.mark.slow
        ),
        (wrong(say_no("wheels are going")), "wheels up", "not confirmed: nothing moved"),
        (wrong(say_no("both wheels")), "forward, by eye", "not as reported"),
        pytest.param(
            wrong(say_no("right wheel")), "left, by eye", "not as reported", marks=pytest.mark.slow
        ),
        (
            wrong(set_field(settings=P2osSettings(model="p3dx"))),
            "forward",
            "by the wheels' speeds",
        ),
        (wrong(set_field(), watchdog=4.5, answers_config=False), "firmware's watchdog", "assumed"),
        pytest.param(
            wrong(set_field(), watchdog=60.0, answers_config=False),
            "firmware's watchdog",
            "turns",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            wrong(set_field(presses=False)),
            "button",
            "motors still on after 15 s",
            marks=pytest.mark.slow,
        ),
        (wrong(set_field(unplug_at=12.0)), "link to the base", "unplugged"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_what_is_wrong_is_found_and_named(it: Robot, name: str, says: str) -> None:
    checks = checks_of(it)
    assert failed(checks) == [name], checks
    assert says in checks[name].detail


@pytest.mark.parametrize("it", [wrong(drain), wrong(press_bumper), wrong(say_no("are going"))])
def test_nothing_moves_when_it_is_not_fit_or_not_allowed(it: Robot) -> None:
    checks_of(it)
    assert it.body.rolled == 0.0
    assert (Cmd.ENABLE, 1) not in it.twin.heard


def test_lost_reports_are_counted() -> None:
    known = parameters(Identity("r", "Pioneer", "p3dx-sh"), MODELS["p3dx-sh"], None, P2osSettings())
    report = Odometry(0.0, 0.0, Pose2(), Twist())
    assert reports([report] * 19, 2.0, known).outcome is Outcome.OK
    check = reports([report] * 15, 2.0, known)
    assert (check.outcome, check.detail) == (Outcome.FAILED, "7.5 a second, 20% lost")


speeds = st.floats(-3, 3) | st.sampled_from([float("nan"), float("inf")])
moves = st.tuples(
    st.floats(-1, 1), st.floats(-1, 1), st.floats(-4, 4), st.floats(0, 1), speeds, speeds
)


@settings(max_examples=40)
@given(st.lists(moves, min_size=1, max_size=12), st.booleans())
def test_the_stands_guard_lets_nothing_pass_but_slow_fresh_and_near(
    steps: list[tuple[float, float, float, float, float, float]], begins: bool
) -> None:
    guard, now, began, strayed = StandGuard(), 0.0, None, False
    for x, y, theta, late, v, omega in steps:
        report = Odometry(now, now, Pose2(x, y, theta), Twist())
        guard.sense(report)
        if began is not None:
            moved = ~began @ report.pose
            strayed = strayed or np.hypot(moved.x, moved.y) > 0.5
        if began is None and begins:
            guard.begin()
            began = report.pose
        now += late
        command = guard.check(Twist(v, omega), now)
        if command.motion is None:
            assert command.reasons
            continue
        assert isinstance(command.motion, Twist)
        assert begins
        assert not strayed
        assert late <= 0.35
        assert abs(command.motion.v) <= 0.15
        assert abs(command.motion.omega) <= np.radians(30)
        assert command.expires <= now + 0.25


@pytest.mark.parametrize(
    ("report", "reason"),
    [
        ({"wheel_stall": (True, False)}, StopReason.WHEEL_STALL),
        ({"bumpers_rear": 1}, StopReason.BUMPER),
        ({"stop_button": True}, StopReason.STOP_BUTTON),
        ({"pose": Pose2(0.45, 0.0)}, StopReason.LIMIT),
        ({"pose": Pose2(0.0, 0.0, 2.2)}, StopReason.LIMIT),
        ({"twist": Twist(4.0, 0.0)}, StopReason.ABSURD_DATA),
    ],
)
def test_what_stops_a_robot_on_its_stand_stops_it_for_good(
    report: dict[str, Any], reason: StopReason
) -> None:
    guard, rest = StandGuard(), Odometry(0.0, 0.0, Pose2(), Twist())
    guard.sense(rest)
    guard.begin()
    assert not guard.check(Twist(0.05), 0.0).stops
    guard.sense(replace(rest, **report))
    guard.sense(rest)
    command = guard.check(Twist(0.05), 0.0)
    assert command.stops
    assert [why.stop for why in command.reasons] == [reason]


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--yes"], "a robot needs your eyes"),
        (["--yes", "--links", "/nowhere", "--real"], "a robot needs your eyes"),
        ([], "links that say sim; give --links"),
        (["--links", "/nowhere"], "run it in a terminal"),
    ],
)
def test_only_a_simulation_is_checked_without_eyes(
    options: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = "hpf-sim"
    if "--real" in options:
        options = [option for option in options if option != "--real"]
        config = str(tmp_path / "real.yaml")
        Path(config).write_text(shipped("hpf.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    assert call(["drive-check", config, *options]) == 2
    assert complaint in capsys.readouterr().err


@pytest.mark.slow
def test_a_simulated_robot_passes_on_real_ports(
    simulation: Callable[[], Simulation], capsys: pytest.CaptureFixture[str]
) -> None:
    twins = simulation()
    assert call(["drive-check", "hpf-sim", "--links", str(twins.links), "--yes"]) == 0
    said = capsys.readouterr().out
    assert "FAILED" not in said
    assert said.count("ok: ") == len(ALL) - 1
    twins.fail("robot:disconnect+60s")
    assert call(["drive-check", "hpf-sim", "--links", str(twins.links), "--yes"]) == 4
    assert "drive-check failed: link to the base" in capsys.readouterr().err
