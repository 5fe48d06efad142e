"""From the counters of status packets to a pose that never jumps; lies are not believed."""

from dataclasses import replace
from math import pi

import pytest

from followerd.geometry import Pose2, wrap_angle
from followerd.hw.p2os.models import MODELS
from followerd.hw.p2os.odometer import Odometer
from followerd.hw.p2os.sip import WRAP, Sip


def steps(model: str, path: list[tuple[float, float, float]]) -> list[Sip]:
    """Status packets along a path of (x m, y m, heading rad), a second apart at full speed."""
    unit = 1000 / MODELS[model].distance
    return [
        Sip(
            x_raw=round(x * unit) % WRAP,
            y_raw=round(y * unit) % WRAP,
            heading_raw=round(theta * 4096 / (2 * pi)) % 4096 - 2048,
            left=1000,
            right=1000,
        )
        for x, y, theta in path
    ]


@pytest.mark.parametrize("model", ["p3dx", "p3dx-sh", "p3at"])
def test_counters_may_wrap_any_time(model: str) -> None:
    path = [(0.7 * i, -0.7 * i, 0.3 * i) for i in range(100)]  # 70 m each way
    odometer = Odometer(MODELS[model])
    for second, sip in enumerate(steps(model, path)):
        odometer.update(sip, float(second))
    # the frame of the first packet is turned by half a circle
    assert odometer.pose.x == pytest.approx(-99 * 0.7, abs=0.01)
    assert odometer.pose.y == pytest.approx(99 * 0.7, abs=0.01)
    assert wrap_angle(odometer.pose.theta - 99 * 0.3) == pytest.approx(0, abs=0.002)
    assert odometer.jumps == 0


def test_a_counter_that_was_set_is_no_motion() -> None:
    odometer = Odometer(MODELS["p3dx-sh"], Pose2(1.0, 2.0, 0.5))
    still = Sip(x_raw=500, y_raw=20, heading_raw=700)
    odometer.update(still, 0.0)
    assert not odometer.follows(Sip(), 0.1)
    assert odometer.follows(Sip(), 0.2)  # said twice
    odometer.update(Sip(), 0.2)
    assert (odometer.pose.x, odometer.pose.y) == pytest.approx((1.0, 2.0))
    assert odometer.pose.theta == pytest.approx(0.5)
    assert odometer.jumps == 1
    odometer.rebase()
    assert odometer.follows(still, 0.3)
    odometer.update(still, 0.3)
    assert odometer.pose.theta == pytest.approx(0.5)
    assert odometer.jumps == 1


def test_one_packet_that_lies_about_the_pose_costs_nothing_else() -> None:
    odometer = Odometer(MODELS["p3dx-sh"])
    honest = steps("p3dx-sh", [(0.1 * i, 0.0, 0.0) for i in range(30)])
    lies = steps("p3dx-sh", [(7.0 + i, 3.0, 1.0) for i in range(30)])
    for count, sip in enumerate(honest):
        told = lies[count] if count % 3 == 1 else sip
        believed = odometer.follows(told, 0.1 * count)
        assert believed == (told is sip)
        if believed:
            # the frame of the first packet is turned by half a circle
            assert -odometer.update(told, 0.1 * count).x == pytest.approx(0.1 * count, abs=0.002)
    assert odometer.jumps == 0


def test_a_speed_that_comes_from_nowhere_is_no_speed_unless_it_is_said_twice() -> None:
    odometer = Odometer(MODELS["p3dx-sh"])
    for stamp, speed, believed in (
        *((0.0, 0, True), (0.1, 200, True), (0.2, 1200, False), (0.3, 300, True)),
        *((0.4, 0, True), (0.5, 1200, False), (0.6, 1200, True)),
    ):
        sip = Sip(left=speed, right=speed)
        assert odometer.follows(sip, stamp) == believed
        if believed:
            odometer.update(sip, stamp)


@pytest.mark.parametrize("speed", [0, 600])
def test_a_heading_that_the_wheels_did_not_turn_is_not_believed(speed: int) -> None:
    """However fast they roll: a turn is what tells them apart."""
    odometer = Odometer(MODELS["p3dx-sh"])
    straight = Sip(x_raw=100, left=speed, right=speed)
    odometer.update(straight, 0.0)
    eighth = replace(straight, x_raw=100 + speed // 10, heading_raw=512)
    assert not odometer.follows(eighth, 0.1)


def test_a_turn_up_to_the_fastest_between_two_reports_is_believed() -> None:
    odometer = Odometer(MODELS["p3dx-sh"])
    odometer.update(Sip(), 0.0)
    for tenth, (raw, wheels) in enumerate([(30, 90), (130, 180), (290, 270), (450, 180)], 1):
        turning = Sip(heading_raw=raw, left=-wheels, right=wheels)
        assert odometer.follows(turning, 0.1 * tenth)
        odometer.update(turning, 0.1 * tenth)
