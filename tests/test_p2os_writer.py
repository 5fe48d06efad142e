"""The one writer: keep-alive is earned, stops come first, the line is never flooded."""

from math import inf, nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.hw.p2os.commands import Cmd, Request, command, join_bytes
from followerd.hw.p2os.motors import MotorPower
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.p2os.writer import BRAKE, BURST, HALT, MOTORS_ON, Caps, Status, Writer
from followerd.messages import Command, TurnBy, Twist, WheelSpeeds, Wish

PASSED_ON = command(Cmd.GETAUX, 6)
CAPS = Caps(speed=0.7, turn=radians(100), vel2_step=0.02)
STOPPING = {
    (Cmd.STOP, None),
    (Cmd.VEL, 0),
    (Cmd.RVEL, 0),
    (Cmd.E_STOP, None),
    (Cmd.ENABLE, 0),
}


def requests(data: bytes) -> list[Request]:
    return [Request.parse(packet.payload) for packet in PacketDecoder().feed(data)]


def only_stops(data: bytes) -> bool:
    return all((r.number, r.argument) in STOPPING for r in requests(data))


def status(stamp: float, *, standing: bool = True, motors: bool = True) -> Status:
    return Status(stamp, heading=radians(170), standing=standing, motors=motors)


def go(motion: Wish, now: float, lasts: float = 0.25) -> Command:
    return Command(now, motion, expires=now + lasts)


@pytest.fixture
def writer() -> Writer:
    """Seen standing with motors on, at 1 s."""
    writer = Writer(9600, CAPS)
    assert writer.due(0.0) == HALT
    assert writer.due(0.2) == HALT
    writer.note(status(0.35))
    assert writer.is_settled
    assert writer.due(1.0) == b""
    return writer


def test_a_session_begins_with_stops_until_the_robot_is_seen_standing() -> None:
    writer = Writer(9600, CAPS)
    assert writer.due(0.0) == HALT
    assert writer.wake_at(0.0) == pytest.approx(0.2)
    writer.note(status(0.15))  # one stop may have been lost
    assert writer.due(0.1) == b""
    assert writer.due(0.2) == HALT
    writer.note(status(0.25))  # measured before the stop could show
    assert writer.due(0.4) == HALT
    writer.note(status(0.35, standing=False))
    assert writer.due(0.6) == HALT
    writer.note(status(0.45))
    assert writer.due(0.8) == b""
    assert writer.wake_at(0.8) == inf


def test_other_commands_wait_until_the_robot_stands() -> None:
    writer = Writer(9600, CAPS)
    writer.ask(Cmd.CONFIG)
    writer.ask(Cmd.SETV, 700)
    assert not writer.is_idle
    assert writer.due(0.0) + writer.due(0.2) == HALT + HALT
    writer.note(status(0.31))
    assert writer.due(0.35) == command(Cmd.CONFIG) + command(Cmd.SETV, 700)
    assert writer.is_idle


def test_a_robot_that_moves_without_leave_is_stopped_again(writer: Writer) -> None:
    writer.note(status(1.05, standing=False))
    assert writer.due(1.1) == HALT
    writer.ask(Cmd.CONFIG)
    assert only_stops(writer.due(1.3))


def test_a_twist_becomes_vel_and_rvel(writer: Writer) -> None:
    command_ = go(Twist(0.25, radians(-20)), 1.0)
    writer.drive(command_, 1.0)
    assert writer.due(1.0) == command(Cmd.VEL, 250) + command(Cmd.RVEL, -20)
    assert writer.served is command_
    assert writer.is_open


def test_wheel_speeds_become_vel2_rounded_not_cut(writer: Writer) -> None:
    writer.drive(go(WheelSpeeds(0.194, -0.111), 1.0), 1.0)
    assert writer.due(1.0) == command(Cmd.VEL2, join_bytes(10, -6))


def test_a_turn_becomes_a_heading_in_the_robots_frame(writer: Writer) -> None:
    writer.drive(go(TurnBy(radians(30), v=0.1), 1.0), 1.0)
    assert writer.due(1.0) == command(Cmd.VEL, 100) + command(Cmd.HEAD, -160)


def test_changing_between_motion_modes_sends_every_setpoint_anew(writer: Writer) -> None:
    writer.drive(go(Twist(0.1, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(go(WheelSpeeds(0.1, 0.1), 1.05), 1.05)
    assert [r.number for r in requests(writer.due(1.05))] == [Cmd.VEL2]
    writer.drive(go(Twist(0.1, 0.0), 1.1), 1.1)
    assert [r.number for r in requests(writer.due(1.1))] == [Cmd.VEL, Cmd.RVEL]


@pytest.mark.parametrize(
    ("motion", "expected"),
    [
        (Twist(5.0, -9.0), command(Cmd.VEL, 700) + command(Cmd.RVEL, -100)),
        (TurnBy(0.0, v=-3.0), command(Cmd.VEL, -700) + command(Cmd.HEAD, 170)),
        (WheelSpeeds(9.0, -9.0), command(Cmd.VEL2, join_bytes(35, -35))),
    ],
)
def test_no_command_exceeds_the_caps(writer: Writer, motion: Wish, expected: bytes) -> None:
    writer.drive(go(motion, 1.0), 1.0)
    assert writer.due(1.0) == expected


@pytest.mark.parametrize("motion", [Twist(nan, 0.0), WheelSpeeds(0.1, inf), TurnBy(nan)])
def test_a_motion_that_is_no_number_stops(writer: Writer, motion: Wish) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(go(motion, 1.1), 1.1)
    assert writer.due(1.1) == HALT


def test_an_unchanged_setpoint_is_repeated_after_200_ms_only(writer: Writer) -> None:
    written = []
    for step in range(10):
        now = 1.0 + 0.05 * step
        writer.drive(go(Twist(0.3, 0.0), now), now)
        written.append(bool(writer.due(now)))
    assert written == [step % 4 == 0 for step in range(10)]


def test_only_the_channel_that_changed_is_sent(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(go(Twist(0.3, radians(5)), 1.05), 1.05)
    assert writer.due(1.05) == command(Cmd.RVEL, 5)


def test_a_repetition_is_not_reported_as_the_newest_command(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(go(Twist(0.3, 0.0), 1.1), 1.1)
    assert writer.due(1.1) == b""
    assert writer.due(1.2) != b""
    assert writer.served is None


def test_without_a_newer_command_the_robot_stops_when_it_expires(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.1), 1.0, lasts=0.15), 1.0)
    writer.due(1.0)
    assert writer.wake_at(1.0) == pytest.approx(1.15)
    assert writer.due(1.14) == b""
    assert writer.due(1.15) == HALT
    assert not writer.is_open
    writer.note(status(1.2, standing=False))
    assert writer.due(1.35) == HALT
    writer.note(status(1.46))
    assert [writer.due(now) for now in (1.55, 2.0, 9.0)] == [b"", b"", b""]


def test_motors_found_off_stop_the_robot_and_the_decision_that_says_so_is_served(
    writer: Writer,
) -> None:
    """They may be said to be off and be on."""
    writer.drive(go(Twist(0.3, 0.1), 1.0), 1.0)
    writer.due(1.0)
    writer.note(status(1.1, standing=False, motors=False))
    assert writer.due(1.1) == HALT
    decided = Command(1.11, None, 1.11)
    writer.drive(decided, 1.11)
    assert writer.due(1.11) == b""
    assert writer.served is decided
    assert writer.due(1.3) == HALT
    assert writer.served is None


def test_after_a_gap_the_old_setpoints_are_cleared_before_new_ones_are_sent(
    writer: Writer,
) -> None:
    writer.drive(go(Twist(0.3, 0.1), 1.0), 1.0)
    writer.due(1.0)
    late = go(Twist(0.2, 0.0), 4.0)  # the process was frozen; nobody asked what was due
    writer.drive(late, 4.0)
    assert writer.due(4.0) == HALT + command(Cmd.VEL, 200) + command(Cmd.RVEL, 0)
    assert writer.served is late


def test_a_command_that_came_too_late_opens_nothing(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 0.7, lasts=0.25), 1.0)
    assert not writer.is_open
    assert writer.due(1.0) == b""


def test_a_stop_is_written_at_once_and_counts_as_served(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    stop = Command(1.01)
    writer.drive(stop, 1.01)
    assert writer.wake_at(1.01) == 1.01
    assert writer.due(1.01) == HALT
    assert writer.served is stop
    writer.drive(Command(1.03), 1.03)
    assert writer.due(1.03) == b""  # said already


def test_an_emergency_brakes_first_and_clears_the_setpoints_when_it_stands(
    writer: Writer,
) -> None:
    writer.drive(go(Twist(0.6, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(Command(1.1, emergency=True), 1.1)
    assert writer.due(1.1) == BRAKE
    writer.drive(Command(1.2), 1.2)  # a plain stop does not soften it
    writer.note(status(1.2, standing=False))
    assert writer.due(1.3) == BRAKE
    writer.note(status(1.45))
    assert writer.due(1.46) == HALT
    writer.drive(Command(1.5, emergency=True), 1.5)
    assert writer.due(1.66) == HALT
    writer.note(status(1.8))
    assert writer.is_settled
    writer.drive(Command(1.9, emergency=True), 1.9)
    assert writer.due(2.0) == b""


def test_an_emergency_hardens_a_stop_that_is_under_way(writer: Writer) -> None:
    writer.drive(go(Twist(0.6, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.drive(Command(1.1), 1.1)
    assert writer.due(1.1) == HALT
    writer.drive(Command(1.15, emergency=True), 1.15)
    assert writer.due(1.15) == BRAKE


def test_the_gate_stays_closed_while_the_motors_are_off(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.note(status(1.1, motors=False))
    assert writer.due(1.1) == HALT
    writer.drive(go(Twist(0.3, 0.0), 1.15), 1.15)
    assert not writer.is_open
    assert only_stops(writer.due(1.4))


def test_motors_go_off_at_once_and_on_only_when_it_stands(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.motors_off()
    assert writer.wake_at(1.01) == 1.01
    assert writer.due(1.01) == command(Cmd.ENABLE, 0)
    writer.motors_on()
    writer.drive(Command(1.1), 1.1)
    assert writer.due(1.1) + writer.due(1.3) == HALT + HALT
    writer.note(status(1.41))
    assert writer.due(1.45) == MOTORS_ON
    assert [r.number for r in requests(MOTORS_ON)] == [Cmd.ENABLE, Cmd.VEL, Cmd.RVEL]


def test_a_flood_of_commands_leaves_half_of_a_slow_line_free(writer: Writer) -> None:
    sent, newest = 0, 0
    for step in range(1000):
        now = 1.0 + 0.002 * step
        writer.drive(go(Twist(0.0003 * step, 0.001 * step), now), now)
        data = writer.due(now)
        sent += len(data)
        for request in requests(data):
            if request.number == Cmd.VEL:
                newest = request.integer
    assert sent <= 0.5 * 960 * 2.0 + BURST
    assert sent > 0.4 * 960 * 2.0
    assert newest == pytest.approx(300, abs=25)  # the newest overwrote what waited


def test_a_stop_does_not_wait_for_the_governor(writer: Writer) -> None:
    for step in range(100):
        now = 1.0 + 0.002 * step
        writer.drive(go(Twist(0.001 * step, 0.01 * step), now), now)
        writer.due(now)
    writer.drive(Command(1.2), 1.2)
    assert writer.due(1.2) == HALT


def test_what_the_governor_held_back_goes_out_when_it_may(writer: Writer) -> None:
    for step in range(1, 5):  # the fourth is one too many at once
        held_back = go(Twist(0.01 * step, 0.05 * step), 1.0)
        writer.drive(held_back, 1.0)
        written = writer.due(1.0)
    assert written == b""
    assert writer.served is None
    first = writer.wake_at(1.0)
    assert 1.0 < first < 1.02
    assert len(requests(writer.due(first))) == 1
    second = writer.wake_at(first)
    assert first < second < 1.04
    assert len(requests(writer.due(second))) == 1
    assert writer.served is held_back


def test_long_traffic_is_spread_over_time(writer: Writer) -> None:
    for _ in range(4):
        writer.ask(Cmd.TTY2, bytes(90))
    times = []
    now = 1.0
    while not writer.is_idle:
        if writer.due(now):
            times.append(now)
        now = max(writer.wake_at(now), now + 0.001) if not writer.is_idle else now
    assert times[-1] - times[0] > 3 * 90 / 480 * 0.9


def test_what_is_passed_on_waits_for_the_gate_or_for_standstill(writer: Writer) -> None:
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    writer.due(1.0)
    writer.relay(PASSED_ON)
    assert writer.relayed_backlog == len(PASSED_ON)
    assert writer.due(1.05) == PASSED_ON  # the gate is open
    writer.relay(PASSED_ON)
    writer.drive(Command(1.1), 1.1)
    assert writer.due(1.1) == HALT
    writer.note(status(1.2, standing=False))
    assert writer.due(1.3) == HALT
    writer.note(status(1.45))
    assert writer.wake_at(1.46) == 1.46
    assert writer.due(1.46) == PASSED_ON
    assert writer.wake_at(1.46) == inf


def test_setpoints_go_before_what_is_passed_on(writer: Writer) -> None:
    for _ in range(4):
        writer.relay(bytes(40))
    writer.drive(go(Twist(0.3, 0.0), 1.0), 1.0)
    first = writer.due(1.0)
    assert first == command(Cmd.VEL, 300) + command(Cmd.RVEL, 0)  # no room for more
    due = writer.wake_at(1.0)
    assert 1.0 < due < 1.1
    assert writer.due(due) == bytes(40)
    writer.drive(go(Twist(0.4, 0.0), due), due)
    assert writer.due(due) == command(Cmd.VEL, 400)  # some of the line was kept for it


events = st.one_of(
    st.tuples(st.just("drive"), st.floats(-1, 1), st.floats(0.0, 0.4)),
    st.tuples(st.just("stop"), st.booleans(), st.none()),
    st.tuples(st.just("status"), st.booleans(), st.booleans()),
    st.tuples(st.just("ask"), st.none(), st.none()),
    st.tuples(st.just("relay"), st.none(), st.none()),
    st.tuples(st.just("wait"), st.floats(0.001, 1.0), st.none()),
)


@given(st.lists(events, max_size=60))
def test_whatever_happens_nothing_but_stops_passes_a_closed_gate(
    story: list[tuple[str, float | bool | None, float | bool | None]],
) -> None:
    writer, now, allowed_until = Writer(9600, CAPS), 0.0, -inf
    for kind, first, second in story:
        now += 0.01
        match kind:
            case "drive":
                moves = go(Twist(float(first or 0), 0.2), now, float(second or 0))
                writer.drive(moves, now)
                if moves.expires > now:
                    allowed_until = moves.expires
            case "stop":
                writer.drive(Command(now, emergency=bool(first)), now)
                allowed_until = -inf
            case "status":
                writer.note(status(now, standing=bool(first), motors=bool(second)))
            case "ask":
                writer.ask(Cmd.CONFIG)
            case "relay":
                writer.relay(PASSED_ON)
            case _:
                now += float(first or 0)
        data = writer.due(now)
        if now >= allowed_until and not writer.is_settled:
            assert only_stops(data)
        if now >= allowed_until and writer.is_settled:
            rest = data.replace(command(Cmd.CONFIG), b"").replace(PASSED_ON, b"")
            assert only_stops(rest)
        assert not writer.is_open or now < allowed_until
        assert writer.wake_at(now) >= now


def test_motors_are_asked_for_until_seen() -> None:
    power = MotorPower()
    power.start_session()
    assert power.due(0.0, is_settled=True) is None
    assert power.ask(on=True)
    assert power.due(0.0, is_settled=False) is None
    assert power.due(0.1, is_settled=True) is True
    assert power.due(0.2, is_settled=True) is None
    assert power.due(0.7, is_settled=True) is True
    power.note(on=True, stop_button=False)
    assert power.due(2.0, is_settled=True) is None
    assert power.ask(on=False)
    assert power.due(2.0, is_settled=False) is False
    power.note(on=False, stop_button=False)
    assert not power.is_taken
    assert power.ask(on=True)


@pytest.mark.parametrize("stop_button", [True, False])
def test_motors_that_a_person_switched_off_stay_off(stop_button: bool) -> None:
    power = MotorPower()
    power.ask(on=True)
    power.note(on=True, stop_button=False)
    power.note(on=False, stop_button=stop_button)
    assert power.is_taken
    assert not power.ask(on=True)
    power.start_session()  # pulling the cable does not get round it
    power.note(on=False, stop_button=False)
    assert not power.ask(on=True)
    power.note(on=True, stop_button=False)  # the person pressed MOTORS
    assert power.ask(on=True)


def test_a_stop_button_withdraws_a_pending_wish() -> None:
    power = MotorPower()
    power.ask(on=True)
    power.note(on=False, stop_button=True)
    assert power.due(9.0, is_settled=True) is None
