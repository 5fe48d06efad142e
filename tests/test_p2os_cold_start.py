"""Whatever state the base was left in, the driver brings it to report, and never moves it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.p2os.commands import BAUDS, Cmd, command, join_bytes
from followerd.hw.p2os.sip import Tail
from followerd.messages import Twist
from tests.p2os_bench import Bench, RecordingTwin, bench, story

Said = list[tuple[int, int | bytes | None]]

OPENED: Said = [(0, None), (1, None), (2, None), (1, None)]
LONGEST = 15.0  # s until it reports, from any state


@dataclass(frozen=True, slots=True)
class Left:
    """What was said to the base before, how long ago, and what happened to it since."""

    said: Said = field(default_factory=list)
    ago: float = 0.0  # s
    options: dict[str, Any] = field(default_factory=dict)
    then: Callable[[Bench], None] | None = None


def driving(*orders: tuple[int, int], at: int = 0) -> Said:
    return [*OPENED, (Cmd.ENABLE, 1), (Cmd.HOSTBAUD, at), *orders]


FORWARD = (Cmd.VEL, 400)
STATES: dict[str, Left] = {
    "waiting": Left(),
    "after SYNC0": Left(OPENED[:1]),
    "after SYNC1": Left(OPENED[:2]),
    "connected, servers closed": Left(OPENED[:3]),
    "connected, servers closed, at 38400": Left([*OPENED[:3], (Cmd.HOSTBAUD, 2)]),
    "session open": Left(OPENED),
    **{f"flash says {baud}": Left(options={"host_baud": baud}) for baud in BAUDS},
    **{f"driving at {baud}": Left(driving(FORWARD, at=i)) for i, baud in enumerate(BAUDS)},
    "driving at 115200, flash says 19200": Left(
        driving(FORWARD, at=4), options={"host_baud": 19200}
    ),
    **{
        f"stopped by its watchdog at {baud}": Left(driving(FORWARD, at=i), ago=4.0)
        for i, baud in enumerate(BAUDS)
    },
    "stopped by its watchdog in a turn": Left(driving((Cmd.RVEL, 60)), ago=4.0),
    "stopped by its watchdog on its way": Left(driving((Cmd.MOVE, 3000)), ago=5.0),
    "stopped by its watchdog, by wheels": Left(driving((Cmd.VEL2, join_bytes(10, 15))), ago=4.0),
    "stopped by its watchdog, heading": Left(driving((Cmd.SETRV, 10), (Cmd.HEAD, 170)), ago=4.0),
    "motors on": Left(driving()),
    "reports of all kinds": Left(
        [*OPENED, (Cmd.GYRO, 1), (Cmd.ENCODER, 2), (Cmd.IOREQUEST, 2), (Cmd.JOYREQUEST, 2)]
    ),
    "asked for bytes of a port": Left([*OPENED, (Cmd.GETAUX, 200)]),
    "booting": Left(then=lambda b: b.twin.reboot(clock.now())),
    "reset while open": Left(OPENED, then=lambda b: b.twin.reboot(clock.now(), 0xFE)),
    "STOP pressed": Left(then=lambda b: b.twin.press_stop_button(True)),
    "sends a wrong CONFIGpac checksum": Left(options={"config_checksum_is_wrong": True}),
    "sends no CONFIGpac": Left(options={"answers_config": False}),
    "cannot change its rate": Left(options={"auto_baud": 0}),
    "reports every 50 ms": Left(options={"sip_cycle": 0.05}),
    "an old tail": Left(options={"tail": Tail.P2OS}),
    "a Pioneer 2": Left(options={"model": "p2dx", "tail": Tail.P2OS}),
    "an AmigoBot": Left(options={"model": "amigo-sh", "tail": Tail.CHARGE_STATE}),
}


async def leave_behind(b: Bench, left: Left) -> None:
    """Bring the base into its state, without a driver."""
    for number, argument in left.said:
        b.twin.receive(command(number, argument), clock.now())
        b.twin.step(clock.now())
    await clock.sleep(left.ago)
    if left.then is not None:
        left.then(b)
        b.twin.step(clock.now())


async def comes_up(b: Bench) -> float:
    """Seconds until the base reports and takes commands; the driver is run again when it fails."""
    began = clock.now()
    while True:
        if not b.is_running:
            b.start()
        try:
            await b.is_up(within=LONGEST)
        except LinkLost:
            assert clock.now() - began < LONGEST
            await clock.sleep(0.25)
        else:
            return clock.now() - began


@pytest.mark.parametrize("state", STATES)
def test_it_reports_by_itself_from_whatever_state_it_was_left_in(state: str) -> None:
    async def told() -> None:
        left = STATES[state]
        async with bench(**left.options) as b:
            await leave_behind(b, left)
            is_held, rolled = b.twin.is_held, b.body.rolled
            assert is_held == ("watchdog" in state)
            seconds = await comes_up(b)
            assert seconds < LONGEST
            assert b.newest.received > clock.now() - 0.2
            if is_held:
                assert b.body.rolled == rolled  # 0 mm
            assert b.body.rolled - rolled < 0.2  # m of both wheels, of a robot left driving
            assert b.body.is_still
            if state == "STOP pressed":
                assert b.newest.stop_button
                return
            await b.motors_on()
            await b.drive(Twist(0.2, 0.0), 1.0)
            assert b.newest.twist.v == pytest.approx(0.2, abs=0.005)

    story(told)


@pytest.mark.parametrize("gone", [0.1, 1.0, 5.0])
def test_a_base_whose_cable_was_out_reports_again_within_2_s(gone: float) -> None:
    async def told() -> None:
        async with bench() as b:
            await b.connect()
            b.line.unplug()
            await clock.sleep(gone)
            b.line.replug()
            assert b.twin.baud == 38400  # its session goes on
            began = clock.now()
            b.restart()
            await b.is_up(within=2.0)
            assert clock.now() - began < 2.0

    story(told)


def test_a_base_that_starts_anew_again_and_again_is_followed() -> None:
    async def told() -> None:
        async with bench() as b:
            for moment in (0.05, 0.2, 0.45, 0.8, 1.5):
                b.start()
                await clock.sleep(moment)
                b.twin.reboot(clock.now())
                assert await comes_up(b) < LONGEST
                await b.leave()
            assert b.body.rolled == 0.0

    story(told)


@pytest.mark.parametrize("lost", range(0, 18, 2))
def test_one_lost_byte_of_the_first_stops_moves_nothing(lost: int) -> None:
    """Each of STOP, VEL 0 and RVEL 0 may be lost before the SYNC0 that would revive the base."""

    class Forgetful(RecordingTwin):
        count: float = -math.inf  # bytes since the driver began

        def receive(self, data: bytes, now: float) -> None:
            at = lost - self.count
            self.count += len(data)
            if 0 <= at < len(data):
                data = data[: int(at)] + data[int(at) + 1 :]
            super().receive(data, now)

    async def told() -> None:
        async with bench(Forgetful) as b:
            await leave_behind(b, Left(driving((Cmd.VEL, 400), (Cmd.RVEL, 50)), ago=4.0))
            rolled = b.body.rolled
            assert isinstance(b.twin, Forgetful)
            b.twin.count = 0
            await comes_up(b)
            assert b.body.rolled - rolled < 0.001  # m

    story(told)
