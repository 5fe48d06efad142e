"""What the base reports besides its pose: battery, gyro, inputs; and what it cannot have said."""

from dataclasses import replace
from math import isnan, nan, radians
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd import clock
from followerd.hw.p2os.battery import BatteryGauge
from followerd.hw.p2os.commands import Cmd
from followerd.hw.p2os.config import Config, Identity
from followerd.hw.p2os.driver import P2osSettings
from followerd.hw.p2os.gyro import GyroRate
from followerd.hw.p2os.models import MODELS
from followerd.hw.p2os.packets import Gyro, Io, Joystick
from followerd.hw.p2os.parameters import parameters
from followerd.hw.p2os.plausible import is_plausible
from followerd.hw.p2os.protocol import frame
from followerd.hw.p2os.sip import Sip, Tail
from followerd.messages import BatteryLevel, Twist
from tests.p2os_bench import bench, story

P3DX = MODELS["p3dx-sh"]
WHO = Identity("robot", "Pioneer", "p3dx-sh")
ALL_EXTRAS = P2osSettings(extra_packets=("gyro", "encoders", "io", "joystick"))


def levels(readings: list[float], low: float = 11.5, shutdown: float = 11.0) -> list[BatteryLevel]:
    """What a gauge says to readings 0.1 s apart."""
    gauge = BatteryGauge(low, shutdown)
    return [gauge.update(volts, 0.1 * count) for count, volts in enumerate(readings)]


@pytest.mark.parametrize(
    ("volts", "level"),
    [
        (12.4, BatteryLevel.GOOD),
        (11.5, BatteryLevel.LOW),
        (11.3, BatteryLevel.WEAK),
        (11.2, BatteryLevel.EMPTY),
        (9.0, BatteryLevel.EMPTY),
        (0.0, BatteryLevel.UNKNOWN),
        (6553.5, BatteryLevel.UNKNOWN),
        (nan, BatteryLevel.UNKNOWN),
    ],
)
def test_a_voltage_has_its_level(volts: float, level: BatteryLevel) -> None:
    assert levels([volts] * 10)[-1] is level


@pytest.mark.parametrize(
    ("low", "shutdown", "level"),
    [
        (nan, nan, BatteryLevel.UNKNOWN),
        (11.5, nan, BatteryLevel.EMPTY),
        (nan, 11.0, BatteryLevel.EMPTY),
        (10.0, 11.0, BatteryLevel.EMPTY),  # contradictory: the higher counts
        (23.0, 22.0, BatteryLevel.EMPTY),
        (10.0, 9.0, BatteryLevel.GOOD),
    ],
)
def test_one_threshold_is_enough(low: float, shutdown: float, level: BatteryLevel) -> None:
    assert levels([11.1] * 10, low, shutdown)[-1] is level


def test_starting_motors_and_damaged_readings_do_not_drain_a_battery() -> None:
    sag = [12.0] * 50 + [11.0] * 8 + [12.0] * 50
    assert set(levels(sag)[5:]) == {BatteryLevel.GOOD}
    damaged = [12.0] * 50 + [6.0, 50.0] + [12.0] * 50
    assert set(levels(damaged)[5:]) == {BatteryLevel.GOOD}


def test_a_battery_that_recovers_at_rest_is_still_empty() -> None:
    said = levels([11.1] * 100 + [11.6] * 300 + [12.6] * 300)
    assert said[99] is said[399] is BatteryLevel.EMPTY
    assert said[-1] is BatteryLevel.GOOD


@given(st.lists(st.floats(0, 70), max_size=60))
def test_no_reading_upsets_the_gauge(readings: list[float]) -> None:
    assert len(levels(readings)) == len(readings)


def test_a_draining_battery_passes_through_its_levels_in_order() -> None:
    order = [BatteryLevel.GOOD, BatteryLevel.LOW, BatteryLevel.WEAK, BatteryLevel.EMPTY]
    drain = [13.0 - 0.002 * step for step in range(1200)]
    ranks = [order.index(level) for level in levels(drain)[4:]]
    assert ranks == sorted(ranks)
    assert set(ranks) == {0, 1, 2, 3}


def test_the_gyro_learns_its_rest_while_the_robot_stands() -> None:
    gyro = GyroRate()
    for _ in range(100):
        gyro.add(Gyro(((520, 25),) * 4), standing=True)
    assert abs(gyro.take()) < radians(6)  # the mean over learning
    gyro.add(Gyro(((520, 25),) * 4), standing=False)
    assert gyro.take() == pytest.approx(0.0, abs=radians(0.1))
    gyro.add(Gyro(((420, 25),) * 4), standing=False)
    assert gyro.take() == pytest.approx(radians(100 * 5 / 1023 * 300 / 2.5 * 1.626), rel=0.01)
    assert isnan(gyro.take())


def test_a_robot_that_is_turned_by_hand_does_not_teach_the_gyro_that_for_rest() -> None:
    gyro = GyroRate()
    for _ in range(1000):
        gyro.add(Gyro(((900, 25),) * 4), standing=True)
    gyro.take()
    gyro.add(Gyro(((512, 25),) * 4), standing=False)
    assert abs(gyro.take()) < radians(60)


def test_the_base_reports_what_it_was_asked_for() -> None:
    async def told() -> None:
        async with bench(has_gyro=1) as b:
            await b.connect(ALL_EXTRAS)
            assert {
                (Cmd.GYRO, 1),
                (Cmd.ENCODER, 2),
                (Cmd.IOREQUEST, 2),
                (Cmd.JOYREQUEST, 2),
            } <= set(b.twin.heard)
            await b.motors_on()
            await b.drive(Twist(0.0, 0.5), 4.0)
            inputs = b.newest.inputs
            assert inputs is not None
            assert inputs.encoders is not None
            assert inputs.encoders[1] == pytest.approx(-inputs.encoders[0], rel=0.01)
            assert inputs.encoders[1] > 10_000
            assert inputs.digital_in == b"\xff" * 4
            assert inputs.analog[-1] * 4 == pytest.approx(12.4, abs=0.05)
            assert inputs.joystick == pytest.approx((0.0, 0.0), abs=0.002)
            assert b.newest.gyro == pytest.approx(0.5, abs=0.03)

    story(told)


def test_nothing_is_asked_for_unless_the_config_says_so() -> None:
    async def told() -> None:
        async with bench(has_gyro=1) as b:
            await b.connect()
            await clock.sleep(0.5)
            numbers = {number for number, _ in b.twin.heard}
            assert not numbers & {Cmd.GYRO, Cmd.ENCODER, Cmd.IOREQUEST, Cmd.JOYREQUEST}
            assert b.newest.inputs is None
            assert isnan(b.newest.gyro)

    story(told)


@pytest.mark.parametrize("has_gyro", [0, 2])
def test_a_gyro_that_the_base_does_not_share_is_not_asked_for(has_gyro: int) -> None:
    async def told() -> None:
        async with bench(has_gyro=has_gyro) as b:
            await b.connect(P2osSettings(extra_packets=("gyro",)))
            assert Cmd.GYRO not in {number for number, _ in b.twin.heard}

    story(told)


def test_a_stick_is_forward_and_left() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            b.twin._out += frame(Joystick(1, 0, 0, 1023, 0).to_payload())
            b.twin._out += frame(Io(b"\x01", b"\x02", (1023, 0)).to_payload())
            await clock.sleep(0.25)
            inputs = b.newest.inputs
            assert inputs is not None
            assert (inputs.joystick, inputs.buttons) == ((1.0, 1.0), (True, False))
            assert (inputs.digital_out, inputs.analog) == (b"\x02", (5.0, 0.0))

    story(told)


@pytest.mark.parametrize(("cycle", "count"), [(0.1, 10), (0.05, 20)])
def test_a_base_that_reports_more_often_is_heard_more_often(cycle: float, count: int) -> None:
    async def told() -> None:
        async with bench(sip_cycle=cycle) as b:
            await b.connect()
            await clock.sleep(0.2)
            before = len(b.seen)
            await clock.sleep(1.0)
            assert len(b.seen) - before == pytest.approx(count, abs=1)
            assert b.base.parameters is not None
            assert b.base.parameters.cycle == cycle

    story(told)


def test_the_batterys_level_is_reported_by_the_bases_own_thresholds() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await clock.sleep(1.0)
            assert b.newest.battery_level is BatteryLevel.GOOD
            for volts, level in (
                (11.4, BatteryLevel.LOW),
                (11.3, BatteryLevel.WEAK),
                (11.0, BatteryLevel.EMPTY),
            ):
                b.twin.status.battery = volts
                await clock.sleep(15.0)
                assert b.newest.battery_level is level
            assert not b.newest.charging

    story(told)


def test_thresholds_of_the_config_go_before_the_bases_own() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect(P2osSettings(low_battery_v=13.0, shutdown_v=12.3))
            await clock.sleep(1.0)
            assert b.newest.battery_level is BatteryLevel.EMPTY

    story(told)


FLASH = Config(
    *("Pioneer", "p3dx-sh", "GJC_3156"),
    rot_vel_top=360,
    trans_vel_top=1000,
    rot_acc_top=300,
    trans_acc_top=2000,
    sip_cycle=100,
    watchdog=2000,
    low_battery=115,
    shutdown_volts=110,
    firmware="2.8",
)


def test_parameters_are_those_of_the_flash_the_type_and_the_config() -> None:
    known = parameters(WHO, P3DX, FLASH, P2osSettings())
    assert (known.serial, known.firmware) == ("GJC_3156", "2.8")
    assert known.track == pytest.approx(0.357, abs=0.001)
    assert (known.front, known.rear, known.half_width) == (0.21, 0.301, 0.2125)
    assert (known.speed, known.turn) == pytest.approx((0.7, radians(100)))
    assert (known.acceleration, known.deceleration) == (0.5, 0.5)
    assert (known.watchdog, known.watchdog_is_read, known.cycle) == (2.0, True, 0.1)
    assert (known.low_battery, known.shutdown) == (11.5, 11.0)


@pytest.mark.parametrize(
    ("flash", "settings", "name", "value"),
    [
        ({"trans_acc_top": 300}, {}, "deceleration", 0.3),
        ({"trans_acc_top": 300}, {}, "acceleration", 0.3),
        ({"rot_acc_top": 50}, {}, "turn_deceleration", radians(50)),
        ({"trans_acc_top": 0}, {"deceleration_mps2": 0.8}, "deceleration", 0.8),
        ({"trans_vel_top": 400}, {}, "speed", 0.4),
        ({"watchdog": 4000}, {}, "speed", 0.35),
        ({}, {"max_speed_mps": 2.0, "blind_distance_m": 9.0}, "speed", 1.0),
        ({"rot_vel_top": 40}, {}, "turn", radians(40)),
        ({}, {"low_battery_v": 12.0}, "low_battery", 12.0),
    ],
)
def test_the_stricter_limit_counts(
    flash: dict[str, Any], settings: dict[str, Any], name: str, value: float
) -> None:
    known = parameters(WHO, P3DX, replace(FLASH, **flash), P2osSettings(**settings))
    assert getattr(known, name) == pytest.approx(value)


def test_voltages_that_no_robot_has_are_not_read() -> None:
    flash = replace(FLASH, low_battery=65535, shutdown_volts=3)
    known = parameters(WHO, P3DX, flash, P2osSettings())
    assert isnan(known.low_battery)
    assert isnan(known.shutdown)


def test_extra_packets_are_named_in_the_config() -> None:
    assert P2osSettings.model_validate({"extra_packets": ["gyro", "io"]}).extra_packets == (
        "gyro",
        "io",
    )
    with pytest.raises(ValueError, match="gyro"):
        P2osSettings.model_validate({"extra_packets": ["sonar"]})


def test_without_flash_parameters_the_type_and_the_usual_are_assumed() -> None:
    known = parameters(WHO, P3DX, None, P2osSettings())
    assert (known.watchdog, known.watchdog_is_read, known.cycle) == (2.0, False, 0.1)
    assert isnan(known.low_battery)
    assert isnan(known.shutdown)
    assert known.speed == 0.7


def test_the_driver_says_what_base_it_drives() -> None:
    async def told() -> None:
        async with bench(watchdog=1.0) as b:
            await b.connect()
            assert b.base.parameters is not None
            assert str(b.base.parameters.identity) == "followerd_twin / Pioneer / p3dx-sh"
            assert b.base.parameters.watchdog == 1.0
            await b.leave()
            assert b.base.parameters is not None  # of the last one

    story(told)


def test_limits_are_said_twice_for_nothing_acknowledges_them() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            await clock.sleep(0.5)
            for limit in (
                *((Cmd.SETV, 700), (Cmd.SETA, 500), (Cmd.SETA, -500)),
                *((Cmd.SETRV, 100), (Cmd.SETRA, 100), (Cmd.SETRA, -100)),
            ):
                assert b.twin.heard.count(limit) == 2

    story(told)


HEALTHY = Sip(
    left=200,
    right=300,
    battery=124,
    sonar=((3, 1500), (15, 5000)),
    tail=Tail.STATE_OF_CHARGE,
    battery_x10=124,
    charge_state=0,
    rotation_x10=171,
)


@pytest.mark.parametrize(
    "change",
    [
        {"left": 5000},
        {"right": -30_000},
        {"left": 3900, "right": -3900},
        {"rotation_x10": -31_488},
        {"battery_x10": 32_000},
        {"sonar": ((200, 1500),)},
        {"sonar": ((3, 60_000),)},
        {"charge_state": 77},
        {"state_of_charge": 127},
    ],
)
def test_what_no_base_says_is_not_believed(change: dict[str, Any]) -> None:
    assert is_plausible(HEALTHY, P3DX)
    assert not is_plausible(replace(HEALTHY, **change), P3DX)


def test_every_model_may_say_that_it_stands_and_that_it_drives() -> None:
    for model in MODELS.values():
        speed = round(model.speed_max / model.velocity)
        echo = tuple((disc, round(5000 / model.range)) for disc in range(model.discs))
        assert is_plausible(Sip(sonar=echo), model)
        assert is_plausible(Sip(left=speed, right=speed, sonar=echo), model)


def test_a_status_that_ends_unlike_all_others_is_skipped_until_it_comes_twice() -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            odd = replace(HEALTHY, tail=Tail.FAULT_FLAGS, left=0, right=0, battery_x10=99)
            b.twin._out += frame(odd.to_payload())
            await clock.sleep(0.25)
            assert 9.9 not in {o.battery for o in b.seen}
            count = len(b.seen)
            await clock.sleep(1.0)
            assert len(b.seen) - count >= 10
            b.twin._out += frame(odd.to_payload()) + frame(odd.to_payload())
            await clock.sleep(0.3)
            assert [o.battery for o in b.seen].count(9.9) == 1
            assert b.newest.battery == 12.4

    story(told)


def test_what_no_gyro_measures_is_not_taken() -> None:
    rng = np.random.default_rng(2)
    gyro = GyroRate()
    for top in (1024, 65536) * 50:
        samples = tuple((int(rate), 0) for rate in rng.integers(top - 1024, top, 4))
        gyro.add(Gyro(samples), standing=bool(rng.integers(2)))
        rate = gyro.take()
        assert isnan(rate) if top > 1024 else abs(rate) < radians(560)
