"""Who stands beside a robot that is driven into faults, and does what an operator would do."""

from math import cos, dist, sin

from followerd import clock
from followerd.control.transitions import Action
from followerd.events import Presence
from followerd.messages import Mode, StopReason
from followerd.runtime.auto_operator import FRESH, AutoOperator, person_ahead
from followerd.runtime.daemon import Daemon
from followerd.sim.rig import Rig
from followerd.sim.truth import Actor

SESSION = "page"
PRESENT = 0.2  # s between the signs of a session
REARM = 2.0  # s between the looks of who arms again
GIVEN_UP = 4.0  # s that it does not follow, before the person is shown again
SHOWN = 0.5  # m, from the person: who is shown is them


async def armed_by_session(daemon: Daemon, until: float) -> None:
    """An operator's page that arms, says that it is there, and after `until` is silent."""
    while daemon.pipeline.modes.mode is not Mode.FOLLOWING:
        await clock.sleep(PRESENT)
    daemon.act(Action.DISARM)
    daemon.act(Action.ARM, SESSION)
    while clock.now() < until:
        daemon.handle(Presence(SESSION))
        await clock.sleep(PRESENT)


async def rearm(daemon: Daemon, rig: Rig, *, heads: bool) -> None:
    """Who stands by: arms again after each stop, and shows the person again to a robot in doubt.

    Knows the person, so nobody else is shown; presses MOTORS where they went off. `heads`: the
    tracker wants to be shown the head.
    """
    operator, idle = AutoOperator(daemon, heads=heads), 0.0
    while True:
        await clock.sleep(REARM)
        decision = daemon.decision
        if decision is None or not daemon.pipeline.modes.confirmed:
            continue
        mode = decision.mode
        is_off = StopReason.MOTORS_OFF in [reason.stop for reason in decision.reasons]
        if is_off and not rig.base.chassis.motors:
            rig.base.press_motors_button()
        idle = idle + REARM if mode in (Mode.IDLE, Mode.HOLDING, Mode.READY) else 0.0
        if idle > GIVEN_UP and _is_ahead(daemon, rig.truths[-1].target):
            await clock.within(GIVEN_UP, operator.run())
        elif mode in (Mode.DISARMED, Mode.FAULT, Mode.IDLE):
            daemon.act(Action.ARM)


def _is_ahead(daemon: Daemon, target: Actor) -> bool:
    """Whether whoever stands before the robot is the person."""
    view, image = daemon.pipeline.view, daemon.vision.newest
    if view is None or image is None or clock.now() - view.scan.stamp > FRESH:
        return False
    found = person_ahead(view.scan, image.camera)
    if found is None:
        return False
    there = target.distance * cos(target.bearing), target.distance * sin(target.bearing)
    return dist(found, there) < SHOWN
