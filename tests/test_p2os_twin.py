"""The simulated base behaves as the firmware does, its dangerous habits included."""

import json
from collections.abc import Iterator
from itertools import pairwise
from math import degrees, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.hw.p2os.commands import BAUDS, Cmd, Request, command, join_bytes
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.packets import Encoders, Gyro, Io, Joystick, ResetNote, SerAux, parse
from followerd.hw.p2os.protocol import PacketDecoder, checksum
from followerd.hw.p2os.sip import MOVING, STOPPED, WRAP, Flags, Sip, Tail
from followerd.sim.twins.p2os import P2osTwin
from followerd.sim.twins.vcc50i import Vcc50iTwin
from tests.p2os_body import AuxDevice, FloorBody

TRANSCRIPTS = Path(__file__).parents[2] / "shared" / "protocols" / "transcripts"
CLIENTS = sorted(TRANSCRIPTS.glob("p2os_*.jsonl"))

Said = tuple[float, Any]  # s, value of a packet


class Bench:
    """A twin on the table: tell it something, let time pass, see what it said."""

    def __init__(self, **options: Any) -> None:
        self.body = FloorBody()
        self.twin = P2osTwin(self.body, np.random.default_rng(1), **options)
        self.now = 0.0
        self.said: list[Said] = []
        self.raw = b""
        self._decoder = PacketDecoder()

    def tell(self, number: int, argument: int | bytes | None = None) -> None:
        self.hear(command(number, argument))

    def hear(self, data: bytes) -> None:
        self.twin.receive(data, self.now)
        self._step()

    def wait(self, seconds: float) -> list[Any]:
        """What it said meanwhile."""
        first, end = len(self.said), self.now + seconds
        self._step()
        while (due := self.twin.wake_at()) <= end:
            assert due > self.now
            self.now = due
            self._step()
        self.now = end
        self._step()
        return [value for _, value in self.said[first:]]

    def open(self, motors: bool = True) -> None:
        for number in (Cmd.PULSE, Cmd.OPEN, Cmd.CLOSE, Cmd.OPEN):
            self.tell(number)
        self.tell(Cmd.ENABLE, int(motors))

    def answers(self, seconds: float) -> list[SerAux]:
        """What came from AUX ports meanwhile."""
        return [value for value in self.wait(seconds) if isinstance(value, SerAux)]

    def sip(self) -> Sip:
        """The next status packet."""
        return next(value for value in self.wait(0.1001) if isinstance(value, Sip))

    def speeds(self) -> tuple[int, int]:
        sip = self.sip()
        return sip.left, sip.right

    def _step(self) -> None:
        data = self.twin.step(self.now)
        self.raw += data
        for packet in self._decoder.feed(data):
            identity = Identity.parse(packet.payload) if packet.type == 2 else None
            self.said.append((self.now, identity or parse(packet.payload)))


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    bench.open()
    yield bench
    assert bench.twin.faults == []


def test_it_greets_as_the_manual_says() -> None:
    bench = Bench(name="MyRobot")
    for number in (0, 1, 2):
        bench.tell(number)
    assert [value for _, value in bench.said] == [
        b"\x00",
        b"\x01",
        Identity("MyRobot", "Pioneer", "p3dx-sh"),
    ]
    assert bench.wait(1.0) == []  # connected, but servers are not open


def test_a_lost_count_is_said_and_starts_anew() -> None:
    bench = Bench()
    bench.tell(Cmd.STOP)
    assert bench.said == []  # not connected: deaf to all but SYNC0
    for number in (0, 0, 1, 1):
        bench.tell(number)
    assert [value for _, value in bench.said] == [b"\x00", b"\x00", b"\x01", ResetNote(0xFF)]
    bench.tell(2)
    assert len(bench.said) == 4


def test_status_comes_every_100_ms_until_close(bench: Bench) -> None:
    bench.wait(1.05)
    times = [now for now, value in bench.said if isinstance(value, Sip)]
    assert times == pytest.approx(list(np.arange(1, 11) / 10))
    bench.tell(Cmd.CLOSE)
    assert bench.wait(1.0) == []
    assert not bench.twin.is_connected


@pytest.mark.parametrize("tail", list(Tail))
def test_the_tail_is_as_long_as_the_firmware_makes_it(tail: Tail) -> None:
    bench = Bench(tail=tail)
    bench.open()
    assert bench.sip().tail == tail


def test_motors_are_off_after_connecting_and_motion_is_ignored_meanwhile() -> None:
    bench = Bench()
    bench.open(motors=False)
    assert not bench.sip().flags & Flags.MOTORS
    bench.tell(Cmd.VEL, 300)
    bench.tell(Cmd.ENABLE, 1)
    bench.wait(1.0)
    assert bench.sip().flags & Flags.MOTORS
    assert bench.body.rolled == 0.0


def test_speed_follows_a_trapezoid(bench: Bench) -> None:
    bench.tell(Cmd.SETA, 500)
    bench.tell(Cmd.SETA, -250)
    bench.tell(Cmd.VEL, 400)
    bench.wait(0.4)
    assert bench.body.speeds == pytest.approx((0.2, 0.2), abs=0.011)
    bench.wait(0.6)
    assert bench.body.speeds == pytest.approx((0.4, 0.4))
    sip = bench.sip()
    assert (sip.type, sip.left, sip.right) == (MOVING, 400, 400)
    bench.tell(Cmd.STOP)
    bench.wait(0.8)
    assert bench.body.speeds == pytest.approx((0.2, 0.2), abs=0.011)
    bench.wait(0.9)
    sip = bench.sip()
    assert (sip.type, sip.left, sip.right) == (STOPPED, 0, 0)


def test_both_channels_combine_as_an_independent_server_does(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 200)
    bench.tell(Cmd.RVEL, 20)
    bench.wait(1.5)
    assert bench.speeds() == pytest.approx((137.7, 262.3), abs=0.6)


def test_wheel_commands_take_the_sign_before_the_split(bench: Bench) -> None:
    bench.tell(Cmd.VEL2, join_bytes(-5, 10))
    bench.wait(1.5)
    assert bench.speeds() == pytest.approx((-100, 200), abs=1)
    bench.tell(Cmd.STOP)
    bench.wait(1.0)
    bench.tell(Cmd.VEL2, join_bytes(-5, 10) & 0xFFFF)  # as another client packs it
    bench.wait(1.5)
    assert bench.speeds() == pytest.approx((-100, 200), abs=1)


def test_one_motion_mode_drops_the_setpoints_of_the_other(bench: Bench) -> None:
    bench.tell(Cmd.VEL2, join_bytes(-5, 5))
    bench.wait(1.0)
    bench.tell(Cmd.ENABLE, 1)  # once more changes nothing
    assert bench.speeds() == pytest.approx((-100, 100), abs=1)
    bench.tell(Cmd.VEL, 100)
    bench.wait(1.8)
    assert bench.speeds() == (100, 100)


def test_limits_hold_for_later_commands_only(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 600)
    bench.wait(1.0)
    bench.tell(Cmd.SETV, 300)
    bench.wait(1.5)
    assert bench.speeds() == (600, 600)
    bench.tell(Cmd.VEL, 600)
    bench.wait(1.5)
    assert bench.speeds() == (300, 300)


def test_no_limit_goes_beyond_the_flash_tops(bench: Bench) -> None:
    bench.tell(Cmd.SETV, 5000)
    bench.tell(Cmd.SETA, 5000)
    bench.tell(Cmd.VEL, 5000)
    bench.wait(0.25)
    assert bench.body.speeds[0] == pytest.approx(0.5, abs=0.03)  # TransAccTop 2 m/s²
    bench.wait(0.5)
    assert bench.speeds() == (1000, 1000)


@pytest.mark.parametrize(
    ("orders", "expected"),
    [
        ([(Cmd.HEAD, 90)], 90),
        ([(Cmd.HEAD, -170)], -170),
        ([(Cmd.HEAD, 40), (Cmd.DHEAD, 30)], 70),
        ([(Cmd.HEAD, 40), (Cmd.DCHEAD, -60)], -20),
        ([(Cmd.DCHEAD, 25)], 25),
    ],
)
def test_turns_arrive_at_their_heading(
    bench: Bench, orders: list[tuple[Cmd, int]], expected: int
) -> None:
    for number, angle in orders:
        bench.tell(number, angle)
        for _ in range(4):
            bench.wait(1.0)
            bench.tell(Cmd.PULSE)
    sip = bench.sip()
    assert sip.heading_raw * 360 / 4096 == pytest.approx(expected, abs=0.5)
    assert sip.type == STOPPED
    assert degrees(bench.body.pose.theta) == pytest.approx(expected, abs=0.5)
    assert sip.control_raw * 360 / 4096 == pytest.approx(expected, abs=0.5)


def test_a_move_ends_after_its_distance(bench: Bench) -> None:
    bench.tell(Cmd.MOVE, -500)
    for _ in range(4):
        bench.wait(1.0)
        bench.tell(Cmd.PULSE)
    assert bench.body.pose.x == pytest.approx(-0.5, abs=0.01)
    assert bench.sip().type == STOPPED


def test_an_emergency_stop_brakes_hard_until_the_next_motion_command(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 600)
    bench.wait(1.95)
    bench.tell(Cmd.E_STOP)
    bench.wait(0.2)
    assert bench.body.is_still
    bench.tell(Cmd.PULSE)
    bench.wait(1.0)
    assert bench.body.is_still
    bench.tell(Cmd.VEL, 100)
    bench.wait(0.2)
    assert 0 < bench.body.speeds[0] < 0.1


def test_the_watchdog_stops_it_and_any_command_sends_it_on_its_way_again(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 400)
    bench.wait(1.99)
    assert bench.body.speeds == pytest.approx((0.4, 0.4))
    held = [bench.twin.is_held]
    bench.wait(2.0)
    assert [*held, bench.twin.is_held] == [False, True]
    assert bench.body.is_still
    assert bench.sip().flags & Flags.MOTORS  # motors and status packets go on
    bench.tell(Cmd.PULSE)
    bench.wait(1.5)
    assert bench.body.speeds == pytest.approx((0.4, 0.4))


def test_a_damaged_command_does_not_feed_the_watchdog(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 400)
    bench.wait(1.9)
    bench.hear(command(Cmd.PULSE)[:-1] + b"\x07")
    bench.wait(0.2)
    assert bench.twin.is_held


def test_odometry_counts_what_the_wheels_rolled(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 300)
    bench.tell(Cmd.RVEL, 30)
    for _ in range(3):
        bench.wait(1.0)
        bench.tell(Cmd.PULSE)
    sip, pose = bench.sip(), bench.body.pose
    x, y = (raw - WRAP if raw >= WRAP // 2 else raw for raw in (sip.x_raw, sip.y_raw))
    assert (x, y) == pytest.approx((1000 * pose.x, 1000 * pose.y), abs=5)
    assert sip.heading_raw * 2 * pi / 4096 == pytest.approx(pose.theta, abs=0.02)
    bench.tell(Cmd.STOP)
    bench.wait(1.5)
    bench.hear(bytes.fromhex("FA FB 04 07 3B 07 3B"))  # SETO with a bare type byte
    sip = bench.sip()
    assert (sip.x_raw, sip.y_raw, sip.heading_raw) == (0, 0, 0)


def test_an_older_base_counts_in_units_of_its_own_and_wraps_at_15_bits() -> None:
    bench = Bench(model="p3dx")
    bench.open()
    bench.tell(Cmd.VEL, -485)
    bench.wait(1.9)
    sip = bench.sip()
    assert sip.x_raw - WRAP == pytest.approx(bench.body.pose.x * 1000 / 0.485, abs=2)
    assert 0 <= sip.x_raw < WRAP


def test_a_held_wheel_stalls_relaxes_and_starts_again(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 300)
    bench.wait(1.2)
    bench.body.blocked = (True, False)
    stalls = [sip.stall_left for sip in bench.wait(0.6) if isinstance(sip, Sip)]
    assert True in stalls
    bench.body.blocked = (False, False)
    bench.tell(Cmd.PULSE)
    bench.wait(1.4)
    sip = bench.sip()
    assert (sip.stall_left, sip.stall_right, sip.left) == (False, False, 300)


def test_a_pressed_bumper_stops_motion_towards_it_only(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 300)
    bench.wait(1.2)
    bench.body.bumpers = (0b00100, 0)
    bench.wait(0.12)
    assert bench.body.is_still
    assert bench.sip().bumpers_front == 0b00100
    bench.tell(Cmd.VEL, -200)
    bench.wait(1.0)
    assert bench.speeds() == (-200, -200)
    bench.tell(Cmd.BUMPSTALL, 0)
    bench.tell(Cmd.VEL, 200)
    bench.wait(1.7)
    assert bench.speeds() == (200, 200)


def test_the_stop_button_cuts_the_motors_until_they_are_enabled(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 300)
    bench.wait(1.0)
    bench.twin.press_stop_button(True)
    sip = bench.sip()
    assert sip.flags & Flags.STOP_BUTTON
    assert not sip.flags & Flags.MOTORS
    assert sip.stall_left
    bench.wait(0.5)
    assert bench.body.is_still
    bench.tell(Cmd.ENABLE, 1)
    assert not bench.sip().flags & Flags.MOTORS
    bench.twin.press_stop_button(False)
    bench.twin.press_motors_button()
    assert bench.sip().flags == Flags.MOTORS | Flags.SONAR_1 | Flags.SONAR_2


def test_e_stall_can_be_switched_off(bench: Bench) -> None:
    bench.tell(Cmd.E_STALL, 0)
    bench.twin.press_stop_button(True)
    assert bench.sip().flags & Flags.MOTORS


def test_closing_a_moving_robots_session_lets_it_roll_out(bench: Bench) -> None:
    bench.tell(Cmd.VEL, 400)
    bench.wait(1.9)
    bench.tell(Cmd.CLOSE)
    bench.wait(0.5)
    assert bench.body.is_still


def test_two_or_three_discs_of_each_array_are_new_in_a_status(bench: Bench) -> None:
    bench.body.echo = 1.5
    sips = [sip for sip in bench.wait(1.61) if isinstance(sip, Sip)]
    assert {len(sip.sonar) for sip in sips} == {4, 6}
    assert {disc for sip in sips for disc, _ in sip.sonar} == set(range(16))
    ranges = [distance for sip in sips for _, distance in sip.sonar]
    assert np.mean(ranges) == pytest.approx(1500, rel=0.01)
    assert len(set(ranges)) > 10
    for before, after in pairwise(sips):
        assert not {d for d, _ in before.sonar} & {d for d, _ in after.sonar}


@pytest.mark.parametrize(("number", "argument"), [(Cmd.SONAR, 0), (Cmd.POLLING, b"")])
def test_sonar_can_be_switched_off(bench: Bench, number: Cmd, argument: int | bytes) -> None:
    assert all(distance == 5000 for _, distance in bench.sip().sonar)  # no echo
    bench.tell(number, argument)
    assert bench.sip().sonar == ()
    bench.tell(Cmd.SONARCYCLE, 20)
    bench.tell(Cmd.SONAR, 1)
    bench.sip()
    assert len(bench.sip().sonar) == 10


def test_it_tells_its_flash_parameters(bench: Bench) -> None:
    bench.tell(Cmd.CONFIG, 1)
    (config,) = [value for _, value in bench.said if isinstance(value, Config)]
    assert config.is_believable
    assert (config.subclass, config.watchdog, config.auto_baud) == ("p3dx-sh", 2000, 2)


def test_flash_parameters_may_have_a_wrong_checksum_or_be_missing() -> None:
    spoilt, silent = Bench(config_checksum_is_wrong=True), Bench(answers_config=False)
    for bench in (spoilt, silent):
        bench.open()
        bench.tell(Cmd.CONFIG)
        assert not any(isinstance(value, Config) for _, value in bench.said)
    assert b"p3dx-sh\0TWIN" in spoilt.raw
    assert b"TWIN" not in silent.raw


def test_extended_packets_stand_before_and_after_the_status() -> None:
    bench = Bench(host_baud=115200)
    bench.open()
    for number in (Cmd.GYRO, Cmd.JOYREQUEST, Cmd.IOREQUEST):
        bench.tell(number, 1)
    bench.tell(Cmd.ENCODER, 2)
    bench.tell(Cmd.RVEL, 40)
    kinds = [type(value) for value in bench.wait(0.205)]
    first = [Gyro, Joystick, Sip, Io, Encoders]
    assert kinds == first + [Gyro, Sip, Encoders]  # a request of 1 is answered once
    bench.wait(1.0)
    gyro, sip, encoders = bench.wait(0.1)
    assert np.mean(gyro.rates()) == pytest.approx(40, abs=2)
    assert sip.rotation_x10 == 400
    assert encoders.right - encoders.left == pytest.approx(
        256_000 * bench.body.pose.theta * 0.001 / 0.0056, rel=0.02
    )


def test_extended_packets_are_dropped_where_the_line_cannot_carry_them(bench: Bench) -> None:
    bench.tell(Cmd.IOREQUEST, 2)
    bench.tell(Cmd.ENCODER, 2)
    assert {type(value) for value in bench.wait(1.0)} == {Sip, Io}
    bench.tell(Cmd.SONARCYCLE, 5)  # makes the status packet longer
    bench.wait(0.2)
    assert {type(value) for value in bench.wait(1.0)} == {Sip}


def test_a_new_line_rate_must_be_confirmed_within_half_a_second(bench: Bench) -> None:
    bench.tell(Cmd.HOSTBAUD, 2)
    assert bench.twin.baud == 38400
    bench.wait(0.49)
    bench.tell(Cmd.PULSE)
    bench.wait(1.0)
    assert bench.twin.baud == 38400
    bench.tell(Cmd.HOSTBAUD, 4)
    bench.wait(0.51)
    assert bench.twin.baud == 9600
    bench.tell(Cmd.HOSTBAUD, len(BAUDS))
    assert bench.twin.baud == 9600


def test_an_aux_port_answers_once_when_enough_bytes_are_there() -> None:
    bench = Bench()
    bench.twin.attach_aux(AuxDevice(lambda data: b"\xfe0000\xef" if data == b"ask" else b""))
    bench.open()
    bench.tell(Cmd.GETAUX, 6)
    bench.tell(Cmd.TTY2, b"as")
    assert bench.answers(0.5) == []
    bench.tell(Cmd.TTY2, b"ask")
    assert bench.answers(0.5) == [SerAux(1, b"\xfe0000\xef")]
    bench.tell(Cmd.TTY2, b"ask")
    assert bench.answers(0.5) == []  # nobody asked for it
    bench.tell(Cmd.GETAUX, 0)  # flushes it
    bench.tell(Cmd.GETAUX, 1)
    assert bench.answers(0.5) == []


@pytest.mark.parametrize(("queues", "answers"), [(False, [b"abcd"]), (True, [b"abcdef", b"ghab"])])
def test_whether_a_new_request_replaces_a_pending_one_is_modelled_both_ways(
    queues: bool, answers: list[bytes]
) -> None:
    bench = Bench(queues_getaux=queues)
    bench.twin.attach_aux(AuxDevice(lambda data: b"abcdefgh"[: len(data)]))
    bench.open()
    bench.tell(Cmd.GETAUX, 6)
    bench.tell(Cmd.GETAUX, 4)
    bench.tell(Cmd.TTY2, b"12345678")
    bench.tell(Cmd.TTY2, b"12")
    assert [value.data for value in bench.answers(1.0)] == answers


def test_each_aux_port_has_commands_and_packets_of_its_own() -> None:
    bench = Bench()
    bench.twin.attach_aux(AuxDevice(lambda _: b"two"), port=2)
    bench.twin.attach_aux(AuxDevice(lambda _: b"three"), port=3)
    bench.open()
    bench.tell(Cmd.GETAUX2, 3)
    bench.tell(Cmd.TTY3, b"?")
    bench.tell(Cmd.GETAUX3, 5)
    bench.tell(Cmd.TTY4, b"?")
    assert bench.answers(0.5) == [SerAux(2, b"two"), SerAux(3, b"three")]


def test_bytes_to_and_from_a_device_take_the_time_of_its_line() -> None:
    bench = Bench(host_baud=115200)
    heard = AuxDevice(lambda data: data)
    bench.twin.attach_aux(heard)
    bench.open()
    bench.wait(0.001)
    began = bench.now
    bench.tell(Cmd.TTY2, bytes(96))
    bench.tell(Cmd.GETAUX, 96)
    (answer,) = bench.answers(1.0)
    came = next(now for now, value in bench.said if value is answer)
    assert heard.heard[0][0] == pytest.approx(began + 0.1)
    assert came >= began + 0.2


def test_the_buffer_of_an_aux_port_is_small() -> None:
    bench = Bench(host_baud=115200)
    bench.twin.attach_aux(AuxDevice(lambda data: data))
    bench.open()
    for _ in range(3):
        bench.tell(Cmd.TTY2, bytes(100))
    bench.wait(1.0)
    bench.tell(Cmd.PULSE)
    for _ in range(3):
        bench.tell(Cmd.GETAUX, 100)
        bench.wait(0.2)
    lengths = [len(value.data) for _, value in bench.said if isinstance(value, SerAux)]
    assert lengths == [100, 100]  # 253 of 300 bytes were kept


def test_an_aux_device_at_another_rate_hears_and_says_noise() -> None:
    bench = Bench()
    device = AuxDevice(lambda data: data)
    bench.twin.attach_aux(device)
    bench.open()
    bench.tell(Cmd.AUX1BAUD, 2)
    bench.tell(Cmd.TTY2, b"anyone there?")
    bench.wait(0.2)
    assert device.heard[0][1] != b"anyone there?"
    bench.tell(Cmd.AUX1BAUD, 0)
    bench.tell(Cmd.TTY2, b"anyone there?")
    bench.wait(0.2)
    assert device.heard[1][1] == b"anyone there?"


def test_what_a_device_said_waits_until_a_status_packet_leaves_room() -> None:
    bench = Bench()
    bench.twin.attach_aux(AuxDevice(lambda data: data))
    bench.open()
    bench.tell(Cmd.GETAUX, 60)
    bench.tell(Cmd.TTY2, bytes(60))
    assert bench.answers(1.0) == []  # 9600 baud carries 96 bytes a cycle
    bench.tell(Cmd.HOSTBAUD, 2)
    assert bench.answers(0.3) == [SerAux(1, bytes(60))]


def test_nothing_on_the_aux_port_answers_nothing(bench: Bench) -> None:
    bench.tell(Cmd.GETAUX, 6)
    bench.tell(Cmd.TTY2, b"anyone?")
    assert all(isinstance(value, Sip) for value in bench.wait(0.5))


@pytest.mark.parametrize("number", [Cmd.RESET, Cmd.MAINTENANCE, 224, 239])
def test_commands_that_must_never_be_sent_are_on_record(number: int) -> None:
    bench = Bench()
    bench.open()
    bench.tell(number)
    assert bench.twin.faults == [f"command {number}"]


@pytest.mark.parametrize("number", sorted(set(Cmd) - {Cmd.CLOSE, Cmd.RESET, Cmd.MAINTENANCE}))
def test_no_command_with_any_argument_upsets_it(bench: Bench, number: Cmd) -> None:
    for argument in (None, 1, -1, b"\x01\x02", b""):
        bench.tell(number, argument)
        assert any(isinstance(value, Sip) for value in bench.wait(0.25))


@pytest.mark.parametrize("note", [None, 0xFE])
def test_a_reboot_forgets_everything_and_takes_its_time(bench: Bench, note: int | None) -> None:
    bench.tell(Cmd.HOSTBAUD, 2)
    bench.tell(Cmd.VEL, 300)
    bench.wait(1.0)
    bench.twin.reboot(bench.now, note)
    assert bench.wait(0.01) == ([] if note is None else [ResetNote(note)])
    assert bench.twin.baud == 9600
    bench.tell(Cmd.PULSE)
    assert bench.wait(1.4) == []  # booting: deaf
    assert bench.body.is_still
    bench.wait(0.1)
    bench.tell(Cmd.PULSE)
    assert bench.said[-1][1] == b"\0"
    assert not bench.twin.is_connected


@pytest.mark.parametrize(("baud", "period"), [(38400, 0.05), (9600, 0.0514)])
def test_a_shorter_cycle_gives_more_packets_as_far_as_the_line_carries_them(
    baud: int, period: float
) -> None:
    bench = Bench(sip_cycle=0.05, host_baud=baud)
    bench.open()
    bench.wait(2.0)
    times = [now for now, value in bench.said if isinstance(value, Sip)]
    assert np.mean(np.diff(times)) == pytest.approx(period, rel=0.03)


def test_commands_longer_than_the_firmware_takes_are_ignored() -> None:
    bench = Bench()
    payload = bytes([Cmd.TTY2, 0x2B, 200]) + bytes(200)
    device = AuxDevice(lambda data: data)
    bench.twin.attach_aux(device)
    bench.open()
    check = checksum(payload).to_bytes(2, "big")
    bench.hear(b"\xfa\xfb" + bytes([len(payload) + 2]) + payload + check)
    bench.wait(0.5)
    assert device.heard == []


def test_angles_are_exact_over_a_whole_turn(bench: Bench) -> None:
    bench.tell(Cmd.RVEL, 90)
    headings = []
    for _ in range(6):
        headings += [v.heading_raw for v in bench.wait(1.0) if isinstance(v, Sip)]
        bench.tell(Cmd.PULSE)
    turned = np.unwrap(np.array(headings) * 2 * pi / 4096)
    assert turned[-1] - turned[-41] == pytest.approx(radians(360), abs=0.01)


@given(
    st.lists(
        st.tuples(
            st.integers(0, 255),
            st.none() | st.integers(-70_000 // 2, 65_535) | st.binary(max_size=30),
            st.floats(0.0, 0.5),
        ),
        max_size=15,
    )
)
def test_whatever_a_client_asks_it_goes_on(
    orders: list[tuple[int, int | bytes | None, float]],
) -> None:
    bench = Bench()
    bench.open()
    for number, argument, pause in orders:
        bench.tell(number, argument)
        bench.wait(pause)
        left, right = bench.body.speeds
        assert max(abs(left), abs(right)) <= 1.0 + radians(360) * 0.18


@pytest.mark.skipif(not CLIENTS, reason="captured clients are not at hand (../shared)")
@pytest.mark.parametrize("client", CLIENTS, ids=lambda path: path.stem)
def test_clients_written_for_real_robots_get_through_their_set_up(client: Path) -> None:
    bench = Bench()
    if "session_left_open" in client.stem:
        bench.open()
        bench.wait(0.25)
    start, before = bench.now, len(bench.said)
    lines = [json.loads(line) for line in client.read_text().splitlines()]
    packets = [packet for line in lines for packet in _decoded(bytes.fromhex(line["hex"]))]
    assert len(packets) == len(lines)
    was_held = False
    for line in lines:
        bench.wait(max(start + line["t"] - bench.now, 0.0))
        was_held |= bench.twin.is_held
        bench.hear(bytes.fromhex(line["hex"]))
    greeting = [value for _, value in bench.said[before:] if isinstance(value, Identity)]
    assert len(greeting) == 1
    assert sum(isinstance(value, Sip) for _, value in bench.said) > 10 * (lines[-1]["t"] - 2.0)
    assert bench.twin.faults == []
    assert not bench.twin.is_connected  # they all take leave
    if "no_pulse" in client.stem:
        assert was_held  # it lets the watchdog expire
    if "drive" in client.stem:
        assert bench.body.rolled > 0.5
    if "vel2" in client.stem:
        assert bench.body.pose.theta > 0.3


PAN_TILT = TRANSCRIPTS / "p2os_client_a_pan_tilt_over_aux.jsonl"


@pytest.mark.skipif(not PAN_TILT.exists(), reason="captured clients are not at hand (../shared)")
def test_a_client_written_for_real_robots_turns_a_camera_head_on_the_aux_port() -> None:
    lines = [json.loads(line) for line in PAN_TILT.read_text().splitlines()]
    packets = [packet for line in lines for packet in _decoded(bytes.fromhex(line["hex"]))]
    asked = [Request.parse(p.payload).string for p in packets if p.type == Cmd.TTY2]
    recorder = AuxDevice(lambda _: b"\xfe0000\xef")
    head = Vcc50iTwin(np.random.default_rng(3), is_local=False, knows_home=True)
    for device in (recorder, head):
        bench = Bench()
        bench.twin.attach_aux(device)
        for line in lines:
            bench.wait(max(line["t"] - bench.now, 0.0))
            bench.hear(bytes.fromhex(line["hex"]))
        answers = [value for _, value in bench.said if isinstance(value, SerAux)]
        assert answers
        assert all(len(answer.data) == 6 for answer in answers)
    assert [data for _, data in recorder.heard] == asked
    assert len(asked) == 14
    # 30° to the right, 10° down, in steps of 0.1125°
    assert (head.head.pan.position, head.head.tilt.position) == pytest.approx((267, -89), abs=2)


def _decoded(data: bytes) -> list[Any]:
    return list(PacketDecoder().feed(data))
