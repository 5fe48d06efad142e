"""The one table of modes: what leads from where to where, and what time alone ends.

DISARMED -> READY -> FOLLOWING <-> HOLDING -> SEARCHING -> IDLE      FAULT, ESTOP (latched)
MANUAL: driven by hand, with a dead-man (FAILSAFES F14)
"""

from enum import Enum

from followerd.messages import Mode


class Action(Enum):
    """What an operator can do."""

    ENROL = "enrol"
    CONFIRM = "confirm"
    ARM = "arm"
    HOLD = "hold"
    DISARM = "disarm"
    STOP = "stop"
    CLEAR = "clear"
    MANUAL = "manual"


class Signal(Enum):
    """What happens by itself."""

    SURE = "enough good frames, motors on"
    UNSURE = "identity or data not good enough"
    LOST = "the person is gone"
    GIVE_UP = "waited or searched long enough"
    RELEASE = "must be armed again"
    BREAK = "a device failed"


ARMED = frozenset(
    {Mode.READY, Mode.FOLLOWING, Mode.HOLDING, Mode.SEARCHING, Mode.IDLE, Mode.MANUAL}
)

TRANSITIONS: dict[tuple[Mode, Action | Signal], Mode] = {
    **{(mode, Action.STOP): Mode.ESTOP for mode in Mode},
    **{(mode, Signal.BREAK): Mode.FAULT for mode in ARMED},
    **{(mode, Signal.RELEASE): Mode.DISARMED for mode in ARMED},
    **{(mode, Action.DISARM): Mode.DISARMED for mode in ARMED},
    **{(mode, Action.ENROL): Mode.DISARMED for mode in ARMED},  # another person: confirm, arm
    **{(mode, Action.HOLD): Mode.HOLDING for mode in ARMED},
    **{(mode, Action.MANUAL): Mode.MANUAL for mode in (Mode.DISARMED, *ARMED)},
    (Mode.ESTOP, Action.CLEAR): Mode.DISARMED,
    (Mode.FAULT, Action.CLEAR): Mode.DISARMED,
    (Mode.FAULT, Action.DISARM): Mode.DISARMED,
    (Mode.DISARMED, Action.ENROL): Mode.DISARMED,
    (Mode.DISARMED, Action.CONFIRM): Mode.DISARMED,
    (Mode.DISARMED, Action.ARM): Mode.READY,
    (Mode.FAULT, Action.ENROL): Mode.FAULT,
    (Mode.FAULT, Action.CONFIRM): Mode.FAULT,
    (Mode.FAULT, Action.ARM): Mode.READY,
    (Mode.HOLDING, Action.ARM): Mode.READY,
    (Mode.IDLE, Action.ARM): Mode.READY,
    (Mode.MANUAL, Action.ARM): Mode.READY,
    (Mode.READY, Signal.SURE): Mode.FOLLOWING,
    (Mode.READY, Signal.GIVE_UP): Mode.IDLE,
    (Mode.FOLLOWING, Signal.UNSURE): Mode.HOLDING,
    (Mode.FOLLOWING, Signal.LOST): Mode.SEARCHING,
    (Mode.HOLDING, Signal.SURE): Mode.FOLLOWING,
    (Mode.HOLDING, Signal.LOST): Mode.SEARCHING,
    (Mode.HOLDING, Signal.GIVE_UP): Mode.IDLE,
    (Mode.SEARCHING, Signal.SURE): Mode.FOLLOWING,
    (Mode.SEARCHING, Signal.GIVE_UP): Mode.IDLE,
}

# The setting (s) after which a mode gives up: a robot that waits must not start when nobody
# thinks of it any more. What the operator holds, stands until he arms.
LONGEST = {Mode.READY: "wait_s", Mode.HOLDING: "wait_s", Mode.SEARCHING: "search_s"}
