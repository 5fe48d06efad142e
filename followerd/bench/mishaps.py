"""What goes wrong under way and is no device's fault, made to happen in a running daemon."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from followerd import clock
from followerd.events import Event, Late, Tracked
from followerd.geometry import Pose2
from followerd.messages import BatteryLevel, Decision, Odometry, RobotPose, Scan
from followerd.runtime.daemon import Daemon

HUNG = "decisions:stuck"
LATE, DOUBTED = "loop:late", "identity:doubted"
JUMPS = "place:jumps"  # only for who lives by the map
TURNING = (LATE, DOUBTED, JUMPS)  # the robot may go on turning to the person
STEP = Pose2(1.0)  # m, of such a jump

Mishap = Callable[[Daemon, float], None]  # begins now, ends at a time (s)


def _hang(daemon: Daemon, _until: float) -> None:
    """From now on nothing new is decided: every event gets the last command again."""
    last = daemon.decision
    assert last is not None
    vars(daemon.pipeline)["step"] = lambda _event, now: replace(last, stamp=now)


def _heard(change: Callable[[Event], Event]) -> Mishap:
    """Events come changed."""

    def mishap(daemon: Daemon, until: float) -> None:
        step = daemon.pipeline.step

        def hear(event: Event, now: float) -> Decision:
            return step(change(event) if now < until else event, now)

        vars(daemon.pipeline)["step"] = hear

    return mishap


def _away(seconds: float) -> Mishap:
    """The loop finds that it was held up."""

    def mishap(daemon: Daemon, _until: float) -> None:
        daemon.handle(Late(seconds))

    return mishap


def _doubted(event: Event) -> Event:
    if not isinstance(event, Tracked) or event.track is None:
        return event
    return replace(event, track=replace(event.track, confidence=0.1))


def _reported(event: Event, **changes: Any) -> Event:
    return replace(event, **changes) if isinstance(event, Odometry) else event


def _jump(daemon: Daemon, until: float) -> None:
    """The robot believes that it is elsewhere on the map."""
    localizer = daemon.pipeline.localizer
    assert localizer is not None
    step = localizer.step

    def elsewhere(
        scan: Scan, ego: Pose2, person: tuple[float, float] | None = None
    ) -> RobotPose | None:
        pose = step(scan, ego, person)
        if pose is None or clock.now() >= until:
            return pose
        there = STEP @ pose.map_from_base, STEP @ pose.map_from_odom
        return replace(pose, map_from_base=there[0], map_from_odom=there[1])

    vars(localizer)["step"] = elsewhere


MISHAPS: dict[str, tuple[str, Mishap]] = {  # the FAILSAFES number, where it has one; what happens
    HUNG: ("F1", _hang),
    LATE: ("F5", _away(0.3)),
    DOUBTED: ("F8", _heard(_doubted)),
    "wheel:stalls": ("F13", _heard(partial(_reported, wheel_stall=(True, False)))),
    "bumper:pressed": ("F13", _heard(partial(_reported, bumpers_front=4))),
    "button:pressed": ("", _heard(partial(_reported, stop_button=True))),
    "battery:empty": ("", _heard(partial(_reported, battery_level=BatteryLevel.EMPTY))),
    "computer:suspended": ("F15", _away(3.0)),
    JUMPS: ("F17", _jump),
}
