"""The base driver against the simulated base, over a line at its rate, in virtual time."""

import asyncio
from itertools import pairwise
from math import degrees, hypot, radians
from typing import Any

import numpy as np
import pytest

from followerd import clock
from followerd.errors import LinkLost, SetupError
from followerd.geometry import Pose2, wrap_angle
from followerd.hw.p2os.commands import Cmd, Request, command
from followerd.hw.p2os.driver import SWEEP, P2osBase, P2osSettings
from followerd.hw.p2os.models import MODELS
from followerd.hw.p2os.protocol import PacketDecoder, frame
from followerd.hw.p2os.sip import Sip, Tail
from followerd.hw.stream import Received
from followerd.messages import Command, TurnBy, Twist, WheelSpeeds
from followerd.sim.faults import Fault, FaultKind
from followerd.sim.line import Line
from tests.p2os_bench import HALT, STOPPING, RecordingTwin, bench, story
from tests.p2os_body import FloorBody


def test_it_connects_sets_limits_and_raises_the_line_rate() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect(within=2.0)
            assert b.twin.heard[:6] == [*HALT, (0, None), (1, None), (2, None)]
            assert b.twin.baud == 38400
            await clock.sleep(0.2)
            for wanted in [
                (Cmd.SETV, 700),
                (Cmd.SETA, 500),
                (Cmd.SETA, -500),
                (Cmd.SETRV, 100),
                (Cmd.SETRA, 100),
                (Cmd.SETRA, -100),
                (Cmd.SONAR, 1),
            ]:
                assert wanted in b.twin.heard
            assert not b.newest.motors_enabled
            assert b.newest.base_id == "followerd_twin / Pioneer / p3dx-sh"
            assert b.newest.battery == 12.4
            assert (Cmd.PULSE, None) not in b.twin.heard[4:]

    story(told)


@pytest.mark.parametrize("left_alone", [0.1, 3.0])
@pytest.mark.parametrize("code", [0, 2])
def test_reconnecting_after_a_crash_at_speed_never_moves_the_robot_again(
    code: int, left_alone: float
) -> None:
    async def told() -> None:
        async with bench(auto_baud=2 if code else 0) as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.5, 0.3), 2.0)
            b.line.unplug()  # as if killed: no farewell
            await clock.sleep(left_alone)
            b.line.replug()
            stood = b.twin.is_held and b.body.is_still
            rolled = b.body.rolled
            fastest = 0.0
            b.start()
            while b.base.caps is None:
                await clock.sleep(0.005)
                fastest = max(fastest, *map(abs, b.body.speeds))
            if left_alone > 2:
                assert b.body.rolled == rolled
                assert stood
            assert fastest <= 0.56
            assert b.body.is_still
            await b.motors_on()
            await clock.sleep(1.0)
            assert b.body.is_still

    story(told)


class SilentLink:
    """Nobody is at the other end; itself its only stream. Keeps what was written at which rate."""

    name = "nowhere"

    def __init__(self) -> None:
        self.baud = 0
        self.written: list[tuple[int, bytes]] = []

    async def open(self, device: str, baud: int) -> "SilentLink":
        self.baud = baud
        return self

    async def read(self, at_least: int = 1) -> Received:
        await clock.sleep(1e6)
        return Received(b"", 0.0)

    def write(self, data: bytes) -> None:
        self.written.append((self.baud, data))

    async def drain(self) -> None: ...

    def set_baud(self, baud: int) -> None:
        self.baud = baud

    def discard_input(self) -> None: ...

    def close(self) -> None: ...


def test_what_stops_the_robot_precedes_the_first_sync_at_every_line_rate() -> None:
    link = SilentLink()

    async def told() -> None:
        with pytest.raises(LinkLost, match="nobody answers; switch the robot on"):
            await P2osBase(P2osSettings(), link).run(lambda _: None)
        assert clock.now() < 10.0

    story(told)
    for baud in SWEEP:
        at_rate = b"".join(data for rate, data in link.written if rate == baud)
        numbers = [Request.parse(p.payload).number for p in PacketDecoder().feed(at_rate)]
        before = numbers[: numbers.index(0)]
        assert before
        assert before == [Cmd.STOP, Cmd.VEL, Cmd.RVEL] * (len(before) // 3)
        assert Cmd.CLOSE in numbers  # a base that is connected without servers hears this only


class Babbling(RecordingTwin):
    """Answers the first SYNCs wrongly."""

    wrong: tuple[bytes, ...] = (b"\x02", b"\xff", b"\x01")

    def _send(self, payload: bytes) -> None:
        if len(payload) == 1 and self.wrong:
            payload, self.wrong = self.wrong[0], self.wrong[1:]
        super()._send(payload)


def test_wrong_echoes_start_the_count_anew() -> None:
    async def told() -> None:
        async with bench() as b:
            b.twin = Babbling(b.body, np.random.default_rng(1))
            b.line = Line(b.twin, np.random.default_rng(2), "robot")
            pump = asyncio.create_task(b.line.run())
            await b.connect()
            assert b.twin.wrong == ()
            await b.leave()
            pump.cancel()

    story(told)


def test_a_base_that_never_answers_rightly_is_given_up() -> None:
    class Hopeless(Babbling):
        wrong = (b"\xff",) * 1000

    async def told() -> None:
        line = Line(
            Hopeless(FloorBody(), np.random.default_rng(1)), np.random.default_rng(2), "robot"
        )
        pump = asyncio.create_task(line.run())
        with pytest.raises(LinkLost, match="never rightly"):
            await P2osBase(P2osSettings(), line.link).run(lambda _: None)
        pump.cancel()

    story(told)


def test_a_base_that_sends_no_status_is_given_up() -> None:
    async def told() -> None:
        async with bench(sip_cycle=60.0) as b:
            with pytest.raises(LinkLost, match="sends no status packets"):
                await b.start()

    story(told)


def test_an_unknown_robot_is_refused_by_name_unless_the_config_says_what_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(MODELS, "p9xx", MODELS["p3dx-sh"])
    twin_model = "p9xx"

    async def told() -> None:
        async with bench(model=twin_model) as b:
            monkeypatch.delitem(MODELS, "p9xx")
            with pytest.raises(
                SetupError, match=r"unknown robot type 'p9xx'.*base\.model.*p3at-sh"
            ):
                await b.start()
            assert not b.twin.is_connected
            await b.connect(P2osSettings(model="P3AT-SH"))

    story(told)


@pytest.mark.parametrize(
    ("options", "speed"),
    [
        ({}, 0.7),
        ({"watchdog": 4.0}, 0.35),  # 1.4 m blind at most
        ({"watchdog": 4.0, "config_checksum_is_wrong": True}, 0.35),
        ({"watchdog": 1.0}, 0.7),
        ({"watchdog": 4.0, "answers_config": False}, 0.7),  # unknown: 2 s are assumed
    ],
)
def test_speed_is_capped_by_what_the_firmwares_watchdog_allows(
    options: dict[str, Any], speed: float
) -> None:
    async def told() -> None:
        async with bench(**options) as b:
            await b.connect()
            assert b.base.caps is not None
            assert b.base.caps.speed == pytest.approx(speed)
            await clock.sleep(0.3)
            assert (Cmd.SETV, round(1000 * speed)) in b.twin.heard

    story(told)


@pytest.mark.parametrize("options", [{"auto_baud": 1}, {"answers_config": False}])
def test_the_line_rate_stays_where_it_cannot_be_raised(options: dict[str, Any]) -> None:
    async def told() -> None:
        async with bench(**options) as b:
            await b.connect()
            assert b.twin.baud == 9600
            await b.motors_on()
            await b.drive(Twist(0.3, 0.2), 2.0)
            assert b.newest.twist.v == pytest.approx(0.3)

    story(told)


def test_a_base_that_does_not_follow_to_the_new_line_rate_is_met_at_the_old_one() -> None:
    class Stubborn(RecordingTwin):
        def _serve(self, request: Request) -> None:
            if request.number != Cmd.HOSTBAUD:
                super()._serve(request)

    async def told() -> None:
        async with bench() as b:
            b.twin = Stubborn(b.body, np.random.default_rng(1))
            b.line = Line(b.twin, np.random.default_rng(2), "robot")
            pump = asyncio.create_task(b.line.run())
            await b.connect()
            await clock.sleep(1.0)
            assert b.newest.received > clock.now() - 0.11
            await b.leave()
            pump.cancel()

    story(told)


@pytest.mark.parametrize("tail", [Tail.P2OS, Tail.BATTERY_X10, Tail.STATE_OF_CHARGE])
@pytest.mark.parametrize("model", ["p3dx", "p3dx-sh", "p2dx"])
def test_odometry_agrees_with_what_the_body_did(model: str, tail: Tail) -> None:
    async def told() -> None:
        async with bench(model=model, tail=tail) as b:
            await b.connect()
            b.base.enable_motors(True)
            await clock.sleep(0.5)
            await b.drive(Twist(0.5, 0.4), 4.0)
            await b.drive(Twist(-0.2, -0.7), 2.0)
            b.base.drive(Command(clock.now()))
            await clock.sleep(2.0)
            pose, true = b.newest.pose, b.body.pose
            assert (pose.x, pose.y) == pytest.approx((true.x, true.y), abs=0.01)
            assert wrap_angle(pose.theta - true.theta) == pytest.approx(0, abs=0.01)
            assert b.newest.twist == Twist()

    story(told)


def test_the_pose_goes_on_across_sessions_and_counter_resets() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.5, 0.5), 3.0)
            before = b.newest.pose
            b.twin.receive(command(Cmd.SETO), clock.now())
            await clock.sleep(0.12)
            after = b.newest.pose
            assert (after.x, after.y) == pytest.approx((before.x, before.y), abs=0.1)
            await clock.sleep(2.0)
            stood = b.newest.pose
            b.twin.drop_session()
            await clock.sleep(0.4)
            b.restart()
            await b.is_up()
            gone = ~stood @ b.newest.pose
            assert (gone.x, gone.y, gone.theta) == pytest.approx((0, 0, 0), abs=1e-9)

    story(told)


def test_stamps_are_those_of_the_first_byte() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await clock.sleep(0.5)
            cycle = b.newest.stamp * 10
            assert b.newest.received - b.newest.stamp == pytest.approx(0.0155, abs=0.004)
            stamps = np.array([o.stamp for o in b.seen[-4:]])
            assert np.diff(stamps) == pytest.approx(0.1, abs=1e-6)
            assert cycle > 0

    story(told)


def test_sonar_is_reported_where_the_disc_sits() -> None:
    async def told() -> None:
        async with bench() as b:
            b.body.echo = 1.2
            await b.connect()
            readings = {r.disc: r for o in b.seen for r in o.sonar}
            assert set(readings) == set(range(16))
            assert readings[3].pose == Pose2(0.166, 0.027, radians(10))
            assert readings[3].range == pytest.approx(1.2, abs=0.06)

    story(told)


def test_when_commands_stop_coming_the_robot_stops() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.6, 0.0), 2.0)
            last = clock.now() - 0.05
            await clock.sleep(0.02)
            first = len(b.twin.heard)
            await clock.sleep(3.0)
            told_at = b.twin.heard_at[first:]
            assert b.twin.heard[first : first + 3] == HALT
            assert told_at[0] <= last + 0.25 + 0.01
            assert set(b.twin.heard[first:]) <= STOPPING
            assert b.body.is_still
            count = len(b.twin.heard)
            await clock.sleep(5.0)  # standing: nothing keeps the firmware's watchdog quiet
            assert len(b.twin.heard) == count
            assert b.twin.is_held

    story(told)


def test_a_stop_is_on_the_wire_within_milliseconds() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.6, 0.0), 1.0)
            stop = Command(clock.now())
            b.base.drive(stop)
            assert b.sent[-1] == (stop, clock.now())
            await clock.sleep(0.008)
            assert b.twin.heard[-3:] == HALT

    story(told)


def test_commands_are_reported_when_written() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            first = Command(clock.now(), Twist(0.2, 0.0), clock.now() + 0.25)
            b.base.drive(first)
            b.base.drive(Command(clock.now(), Twist(0.2, 0.0), clock.now() + 0.3))
            assert b.sent == [(first, clock.now())]

    story(told)


def test_an_emergency_stop_brakes_harder() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.7, 0.0), 2.0)
            b.base.drive(Command(clock.now(), emergency=True))
            await clock.sleep(0.25)
            assert b.body.is_still
            await clock.sleep(1.0)
            assert b.twin.heard[-3:] == HALT

    story(told)


def test_wheels_and_turns_do_what_they_say() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(WheelSpeeds(0.1, 0.2), 1.5)
            assert b.body.speeds == pytest.approx((0.1, 0.2), abs=0.005)
            b.base.drive(Command(clock.now()))
            await clock.sleep(1.0)
            goal = wrap_angle(b.newest.pose.theta + radians(120))
            for _ in range(100):
                rest = wrap_angle(goal - b.newest.pose.theta)
                await b.drive(TurnBy(rest), 0.05)
            assert degrees(wrap_angle(goal - b.body.pose.theta)) == pytest.approx(0, abs=1.5)

    story(told)


def test_commands_are_dropped_while_not_connected_and_while_motors_are_off() -> None:
    async def told() -> None:
        async with bench() as b:
            b.base.drive(Command(clock.now(), Twist(0.5), clock.now() + 1.0))
            b.start()
            for _ in range(30):  # during set-up
                await b.drive(Twist(0.5, 0.0), 0.05)
            await b.is_up()
            await b.drive(Twist(0.5, 0.0), 1.0)
            await b.motors_on()
            await clock.sleep(1.0)
            assert b.body.rolled == 0.0
            assert {r for r in b.twin.heard if r[0] == Cmd.VEL} == {(Cmd.VEL, 0)}

    story(told)


def test_motors_go_off_at_once_when_asked() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.3, 0.0), 1.0)
            b.base.enable_motors(False)
            await clock.sleep(0.2)
            assert not b.newest.motors_enabled
            await clock.sleep(1.0)
            await b.motors_on()
            assert b.body.is_still

    story(told)


def test_after_the_stop_button_only_the_person_switches_the_motors_on() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.3, 0.0), 1.0)
            b.twin.press_stop_button(True)
            await clock.sleep(0.3)
            assert b.newest.stop_button
            b.twin.press_stop_button(False)
            await clock.sleep(0.3)
            heard = len(b.twin.heard)
            b.base.enable_motors(True)
            await b.drive(Twist(0.3, 0.0), 2.0)
            assert (Cmd.ENABLE, 1) not in b.twin.heard[heard:]
            assert b.body.is_still
            b.twin.press_motors_button()
            await clock.sleep(0.3)
            assert b.body.is_still
            assert b.newest.motors_enabled
            await b.drive(Twist(0.3, 0.0), 1.0)
            assert not b.body.is_still

    story(told)


def test_stall_and_bumpers_are_reported() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.3, 0.0), 1.0)
            b.body.blocked, b.body.bumpers = (False, True), (0b10, 0b1)
            await b.drive(Twist(0.3, 0.0), 1.0)
            assert (b.newest.bumpers_front, b.newest.bumpers_rear) == (0b10, 0b1)
            assert any(o.wheel_stall == (False, True) for o in b.seen) or b.body.is_still

    story(told)


@pytest.mark.parametrize("auto_baud", [0, 2])
def test_a_silent_base_is_lost_within_350_ms_and_told_to_stop(auto_baud: int) -> None:
    async def told() -> None:
        async with bench(auto_baud=auto_baud) as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.3, 0.0), 1.0)
            running = b._running
            assert running is not None
            b.twin.drop_session()
            heard = len(b.twin.heard)
            with pytest.raises(LinkLost, match=r"silent for 0\.35 s"):
                await running
            assert clock.now() - b.newest.received <= 0.35 + 1e-9
            await clock.sleep(0.1)
            if not auto_baud:  # else it fell back to another line rate and hears noise
                assert b.twin.heard[heard:][-3:] == HALT

    story(told)


def test_two_lost_status_packets_alone_are_no_reason_to_stop() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            running = b._running
            for _ in range(5):
                b.twin._next_sip += 0.2
                await clock.sleep(0.5)
            assert running is not None
            assert not running.done()

    story(told)


def test_a_pulled_cable_is_noticed_at_once() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            running = b._running
            assert running is not None
            b.line.unplug()
            began = clock.now()
            with pytest.raises(LinkLost, match="unplugged"):
                await running
            assert clock.now() - began < 0.01
            b.base.drive(Command(clock.now(), Twist(0.3), clock.now() + 1))
            assert b.base.caps is None

    story(told)


@pytest.mark.parametrize("note", [0xFE, 0xFF])
def test_a_controller_reset_ends_the_session(note: int) -> None:
    async def told() -> None:
        async with bench(auto_baud=0) as b:
            await b.connect()
            running = b._running
            assert running is not None
            b.twin.reboot(clock.now(), note)
            with pytest.raises(LinkLost, match="controller was reset"):
                await running
            b.restart()
            await b.is_up()

    story(told)


def test_it_takes_leave_in_an_orderly_way() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await b.motors_on()
            await b.drive(Twist(0.3, 0.0), 1.0)
            began = clock.now()
            await b.leave()
            assert clock.now() - began <= 0.5
            await clock.sleep(0.1)
            assert b.twin.heard[-5:] == [*HALT, (Cmd.ENABLE, 0), (Cmd.CLOSE, None)]
            assert b.twin.heard_at[-1] - b.twin.heard_at[-2] >= 0.08
            assert not b.twin.is_connected

    story(told)


def test_garbage_between_packets_costs_none_of_them() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            count = len(b.seen)
            for _ in range(20):
                await clock.sleep(0.05)
                b.twin._out += b"\xfa\xfb\xfa\x00\xfb"
                await clock.sleep(0.05)
            assert len(b.seen) - count >= 19

    story(told)


def test_a_false_header_delays_status_by_one_packet_at_most() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            running = b._running
            for _ in range(5):
                await clock.sleep(0.33)
                b.twin._out += b"\xfa\xfb\xff"
            assert running is not None
            assert not running.done()
            stamps = np.array([o.stamp for o in b.seen[-12:]])
            assert np.diff(stamps) == pytest.approx(0.1, abs=0.002)

    story(told)


BAD_LINE = (FaultKind.FLIP, FaultKind.DROP, FaultKind.DUPLICATE, FaultKind.GARBAGE, FaultKind.SPLIT)


async def drive_on_a_bad_line(kinds: tuple[FaultKind, ...], share: float, seconds: float) -> None:
    async with bench() as b:
        for kind in kinds:
            b.line.inject(Fault("robot", kind, 5.0, seconds, share))
        await b.connect()
        await b.motors_on()
        await clock.sleep(5.0 - clock.now())
        first, said = len(b.seen), len(b.twin.heard)
        await b.drive(Twist(0.2, 0.3), seconds, period=0.1)
        assert b.is_running
        assert Cmd.STOP not in {number for number, _ in b.twin.heard[said:]}  # no false stop
        reports = b.seen[first + 20 :]
        assert len(reports) > 9.6 * (seconds - 3)
        assert {o.twist.v for o in reports} == {0.2}
        steps = [~one.pose @ two.pose for one, two in pairwise(reports)]
        assert max(hypot(step.x, step.y) for step in steps) < 0.07  # no wrong pose
        pose, true = b.newest.pose, b.body.pose
        assert hypot(pose.x - true.x, pose.y - true.y) < 0.05


@pytest.mark.parametrize("kind", BAD_LINE)
def test_one_damaged_packet_in_twenty_is_no_reason_to_stop(kind: FaultKind) -> None:
    story(lambda: drive_on_a_bad_line((kind,), 0.05, 8.0))


@pytest.mark.slow
def test_ten_minutes_on_a_bad_line_stop_nothing_and_report_nothing_wrong() -> None:
    story(lambda: drive_on_a_bad_line(BAD_LINE, 0.01, 600.0))


def test_a_packet_that_lies_about_its_length_or_is_absurd_is_skipped() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            running = b._running
            payload = bytearray(Sip(sonar=((1, 5),)).to_payload())
            payload[19] = 200
            b.twin._out += frame(bytes(payload)) + frame(b"\x20junk") + frame(b"\x63?")
            b.twin._out += frame(Sip(left=30_000).to_payload())
            await clock.sleep(0.5)
            assert running is not None
            assert not running.done()
            assert {o.twist for o in b.seen} == {Twist()}

    story(told)
