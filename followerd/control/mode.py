"""What the robot is allowed to do: which mode it is in (`transitions`), and what that permits."""

from dataclasses import dataclass, replace
from math import copysign, inf, radians

from pydantic import Field

from followerd.control.freshness import Freshness
from followerd.control.transitions import ARMED, LONGEST, TRANSITIONS, Action, Signal
from followerd.messages import (
    BatteryLevel,
    Fault,
    Mode,
    Odometry,
    Reason,
    StopReason,
    TrackPhase,
    TrackState,
    Twist,
)
from followerd.settings import Settings

GAVE_UP = "waited or searched in vain"
PLACED = frozenset({TrackPhase.CONFIRMED, TrackPhase.OCCLUDED})  # not where it may be anybody
_DRAINED = (BatteryLevel.LOW, BatteryLevel.WEAK)


class ModeSettings(Settings):
    """Bounds on doubt and on time."""

    fresh_before_arming_s: float = Field(2.0, ge=0, description="all sensors, without a break")
    motors_on_within_s: float = Field(3.0, gt=0, description="after arming")
    min_confidence: float = Field(0.4, ge=0, le=1, description="that it is the enrolled person")
    good_frames: int = Field(5, ge=5, description="in a row, before motion resumes")
    unsure_grace_s: float = Field(0.17, ge=0, le=0.2, description="doubt before the robot stops")
    coast_s: float = Field(0.42, ge=0, le=0.45, description="motion after the person is lost")
    wait_s: float = Field(60.0, gt=0, description="for a sure view of the person, armed")
    search_s: float = Field(10.0, ge=0, le=10.0, description="turning to find the person again")
    search_turn_degps: float = Field(25.0, gt=0, le=28.6, description="while searching")
    occluded_s: float = Field(5.0, ge=0, le=5.0, description="following a prediction")
    occluded_sigma_m: float = Field(0.5, gt=0, le=0.5, description="of a prediction followed")
    occluded_speed_mps: float = Field(0.4, ge=0, le=0.4, description="following a prediction")
    suspended_s: float = Field(
        1.0, gt=0.2, description="a computer that was away so long is armed again by hand"
    )
    operator_gone_s: float = Field(
        0.8, gt=0, description="without a sign of the session that armed, before it is over"
    )
    hand_s: float = Field(0.15, gt=0, le=0.15, description="a command of the hand is good for")
    manual_speed_mps: float = Field(0.4, gt=0, le=0.7, description="driven by hand")
    by_legs_s: float = Field(1.95, ge=0, le=2.0, description="following what the laser alone sees")
    by_legs_speed_mps: float = Field(0.3, ge=0, le=0.3, description="the same")
    limp_speed_mps: float = Field(0.3, gt=0, le=0.3, description="while the battery is weak")


@dataclass(frozen=True, slots=True)
class Permission:
    """What the mode allows now."""

    move: bool = False  # may move at all
    max_speed: float = 0.0  # m/s, forward or backward
    search: float = 0.0  # rad/s, turn to find the person; 0 = turn to where the track is
    reasons: tuple[Reason, ...] = ()  # why it is less than everything
    drive: Twist | None = None  # what the operator's hand asks for


class Modes:
    """The state machine: operator's actions, tracks, base reports and faults in, permission out."""

    def __init__(self, settings: ModeSettings, freshness: Freshness) -> None:
        self.settings = settings
        self.freshness = freshness
        self.mode = Mode.DISARMED
        self.enrolled = False
        self.confirmed = False
        self._since = -inf  # s, entry into the mode
        self._why: tuple[Reason, ...] = ()  # what ended the last armed time
        self._held = False
        self._faults: dict[str, Fault] = {}
        self._odometry: Odometry | None = None
        self._phase = TrackPhase.LOST
        self._by_legs = False
        self._good = 0  # good frames in a row
        self._doubt_since = inf  # s, first frame that was not good
        self._side = 1.0  # +1: last seen on the left
        self._session = ""  # that armed; empty: none that could go away
        self._present_at = -inf  # s, last sign of that session
        self._hand = Twist()
        self._hand_at = -inf  # s

    @property
    def armed(self) -> bool:
        """Whether the robot may come to move by itself."""
        return self.mode in ARMED

    def operate(self, action: Action, now: float, session: str = "") -> str:
        """Do what the operator asks; returns why not, or nothing.

        What a `session` arms ends with it.
        """
        if (self.mode, action) not in TRANSITIONS:
            return f"cannot {action.value} while {self.mode.value}"
        if refusal := self._refusal(action, now):
            return refusal
        if action is Action.ENROL:
            self.enrolled, self.confirmed, self._good = True, False, 0
            self._phase, self._doubt_since = TrackPhase.LOST, now
        if action is Action.CONFIRM:
            self.confirmed = True
        if action in (Action.ARM, Action.MANUAL):
            self._session, self._present_at, self._hand_at = session, now, -inf
        self._held = action is Action.HOLD
        self._go(action, now)
        return ""

    def track(self, track: TrackState | None, sigma: float, now: float) -> None:
        """Take the newest track; `sigma` of its position in m, inf when unknown."""
        self._phase = TrackPhase.LOST if track is None else track.phase
        self._by_legs = track is not None and track.by_legs
        if track is not None and self._phase in PLACED and track.bearing is not None:
            self._side = copysign(1.0, track.bearing)
        sure = track is not None and track.confidence >= self.settings.min_confidence
        if sure and self._phase is TrackPhase.CONFIRMED and not self._by_legs:
            self._good += 1
            self._doubt_since = inf
            return
        self._good = 0
        self._doubt_since = min(self._doubt_since, now)
        if self._phase is TrackPhase.OCCLUDED and not sigma < self.settings.occluded_sigma_m:
            self._phase = TrackPhase.TENTATIVE

    def base(self, odometry: Odometry, now: float) -> None:
        """Take a base report: stalls, bumpers, motors, battery."""
        self._odometry = odometry
        if any(odometry.wheel_stall):
            self._go(Signal.BREAK, now, Reason(StopReason.WHEEL_STALL, "base"))
        if odometry.bumpers_front or odometry.bumpers_rear:
            self._go(Signal.BREAK, now, Reason(StopReason.BUMPER, "base"))
        if odometry.stop_button:
            self._go(Signal.RELEASE, now, Reason(StopReason.STOP_BUTTON, "base"))
        waits = self.mode in (Mode.READY, Mode.MANUAL)
        late = not waits or now - self._since > self.settings.motors_on_within_s
        if late and not odometry.motors_enabled:
            self._go(Signal.RELEASE, now, Reason(StopReason.MOTORS_OFF, "base"))
        if odometry.battery_level is BatteryLevel.EMPTY:
            self._go(Signal.RELEASE, now, _battery(odometry))

    def present(self, session: str, now: float, *, here: bool) -> None:
        """A sign that an operator's session is there, or that it is over."""
        if session != self._session or not session:
            return
        if here:
            self._present_at = now
        else:
            self._go(Signal.RELEASE, now, Reason(StopReason.OPERATOR_GONE, "operator"))

    def drive(self, wanted: Twist, session: str, now: float) -> None:
        """What the hand of the session that drives asks for now."""
        if self.mode is Mode.MANUAL and session == self._session:
            self._hand, self._hand_at = wanted, now

    def late(self, seconds: float, now: float) -> None:
        """The loop was held up so long (FAILSAFES F5; F15: as long as a suspend)."""
        reason = Reason(StopReason.LOOP_LATE, "computer", f"{seconds:.2f} s")
        self._good, self._hand_at = 0, -inf
        if seconds > self.settings.suspended_s:
            self._go(Signal.RELEASE, now, reason)
        else:
            self._doubt_since = min(self._doubt_since, now)
            self._go(Signal.UNSURE, now, reason)

    def jumped(self, distance: float, now: float) -> None:
        """The place on the map that the tracker lives by jumped so far, m (FAILSAFES F17)."""
        reason = Reason(StopReason.ABSURD_DATA, "localizer", f"jumped by {distance:.2f} m")
        self._good, self._doubt_since = 0, min(self._doubt_since, now)
        self._go(Signal.UNSURE, now, reason)

    def fault(self, fault: Fault, now: float) -> None:
        """Take a device's failure or its recovery; a recovery alone moves nothing."""
        if fault.recovered:
            self._faults.pop(fault.device, None)
            return
        self._faults[fault.device] = fault
        self._go(Signal.BREAK, now, Reason(fault.reason, fault.device, fault.detail))

    def permission(self, now: float) -> Permission:
        """Let time pass, then say what is allowed."""
        stale = self.freshness.stale(now)
        self._elapse(stale, now)
        if not self.armed:
            return Permission(reasons=self._standing(now))
        if stale:
            return Permission(reasons=stale)
        if self.mode is Mode.FOLLOWING:
            return self._as_far_as_powered(self._following(now))
        if self.mode is Mode.MANUAL:
            return self._as_far_as_powered(self._by_hand(now))
        if self.mode is Mode.SEARCHING:
            gone = self._phase is TrackPhase.LOST
            turn = radians(self.settings.search_turn_degps) * self._side if gone else 0.0
            return Permission(True, 0.0, turn, (Reason(StopReason.TARGET_LOST, "tracker"),))
        if self.mode is Mode.HOLDING and not self._held:
            return Permission(True, 0.0, 0.0, (Reason(StopReason.TARGET_UNSURE, "tracker"),))
        return Permission(reasons=self._standing(now))

    def _elapse(self, stale: tuple[Reason, ...], now: float) -> None:
        """The transitions that time brings."""
        s = self.settings
        if stale and self.freshness.disarms(now):
            self._go(Signal.RELEASE, now, *stale)
        if self._session and not now - self._present_at <= s.operator_gone_s:
            self._go(Signal.RELEASE, now, Reason(StopReason.OPERATOR_GONE, "operator"))
        doubt = now - self._doubt_since
        lost = self._phase is TrackPhase.LOST
        ready = self._odometry is not None and self._odometry.motors_enabled
        if stale:
            self._good = 0
            self._go(Signal.UNSURE, now)
        elif self._good >= s.good_frames and ready and not self._held:
            self._go(Signal.SURE, now)
        elif lost and doubt >= s.coast_s and not self._held:
            self._go(Signal.LOST, now)
        elif not lost and doubt >= self._patience():
            self._go(Signal.UNSURE, now)
        longest = LONGEST.get(self.mode)
        if longest and not self._held and now - self._since >= getattr(s, longest):
            self._go(Signal.GIVE_UP, now, Reason(StopReason.TARGET_LOST, "tracker", GAVE_UP))

    def _patience(self) -> float:
        if self._phase is TrackPhase.OCCLUDED:
            return self.settings.occluded_s
        return self.settings.by_legs_s if self._by_legs else self.settings.unsure_grace_s

    def _following(self, now: float) -> Permission:
        s = self.settings
        if self._doubt_since == inf:
            return Permission(True, inf)
        if self._phase is TrackPhase.LOST:
            left = max(0.0, 1.0 - (now - self._doubt_since) / s.coast_s) if s.coast_s else 0.0
            coasting = Reason(StopReason.TARGET_LOST, "tracker", "coasting", full_stop=False)
            return Permission(True, s.occluded_speed_mps * left, 0.0, (coasting,))
        if self._by_legs:
            legs = Reason(StopReason.TARGET_UNSURE, "tracker", "by the legs alone", full_stop=False)
            return Permission(True, s.by_legs_speed_mps, 0.0, (legs,))
        doubtful = Reason(StopReason.TARGET_UNSURE, "tracker", self._phase.value, full_stop=False)
        speed = 0.0 if self._phase is TrackPhase.TENTATIVE else s.occluded_speed_mps
        return Permission(True, speed, 0.0, (doubtful,))

    def _by_hand(self, now: float) -> Permission:
        if not now - self._hand_at <= self.settings.hand_s:
            return Permission(reasons=(Reason(StopReason.NO_DRIVING_HAND, "operator"),))
        return Permission(True, self.settings.manual_speed_mps, drive=self._hand)

    def _as_far_as_powered(self, permission: Permission) -> Permission:
        """A low battery is a warning, a weak one makes the robot limp."""
        odometry = self._odometry
        if odometry is None or odometry.battery_level not in _DRAINED:
            return permission
        weak = odometry.battery_level is BatteryLevel.WEAK
        limit = self.settings.limp_speed_mps if weak else inf
        return replace(
            permission,
            max_speed=min(permission.max_speed, limit),
            reasons=(*permission.reasons, replace(_battery(odometry), full_stop=False)),
        )

    def _standing(self, now: float) -> tuple[Reason, ...]:
        """Why the robot stands in a mode that does not move."""
        if self.mode is Mode.ESTOP:
            return (Reason(StopReason.ESTOP),)
        if self.mode is Mode.HOLDING:
            return (Reason(StopReason.HOLD),)
        if self.mode is Mode.IDLE:
            return self._why
        if self.mode is Mode.READY:
            return (Reason(StopReason.START_UP, "", "motors and a steady view of the person"),)
        refusal = self._unfit(now)
        return (*self._why, *refusal) or (Reason(StopReason.DISARMED),)

    def _refusal(self, action: Action, now: float) -> str:
        if action is Action.CONFIRM and not self.enrolled:
            return Reason(StopReason.NO_TARGET).stop.value
        if action is Action.CLEAR and self.mode is Mode.FAULT:
            return "; ".join(map(str, self._outstanding()))
        if action is Action.MANUAL:
            return "; ".join(map(str, self._not_fresh(now)))
        return "; ".join(map(str, self._unfit(now))) if action is Action.ARM else ""

    def _unfit(self, now: float) -> tuple[Reason, ...]:
        """Why the robot cannot be armed now."""
        reasons = self._not_fresh(now)
        if not self.enrolled:
            reasons.append(Reason(StopReason.NO_TARGET))
        elif not self.confirmed:
            reasons.append(Reason(StopReason.NOT_CONFIRMED))
        return tuple(reasons)

    def _not_fresh(self, now: float) -> list[Reason]:
        """Why nothing may drive it now, not even a hand."""
        reasons = [*self._outstanding(), *self.freshness.stale(now)]
        if not reasons and self.freshness.fresh_for(now) < self.settings.fresh_before_arming_s:
            reasons.append(Reason(StopReason.START_UP))
        if self._odometry is not None and self._odometry.stop_button:
            reasons.append(Reason(StopReason.STOP_BUTTON, "base"))
        if self._odometry is not None and self._odometry.battery_level is BatteryLevel.EMPTY:
            reasons.append(_battery(self._odometry))
        return reasons

    def _outstanding(self) -> list[Reason]:
        return [Reason(f.reason, f.device, f.detail) for f in self._faults.values()]

    def _go(self, trigger: Action | Signal, now: float, *why: Reason) -> None:
        """Follow the table; what it does not name changes nothing."""
        goal = TRANSITIONS.get((self.mode, trigger), self.mode)
        if goal is self.mode:
            return
        self.mode, self._since, self._why = goal, now, why
        if goal is Mode.READY:
            self._good = 0
        if goal not in ARMED:
            self._session = ""


def _battery(odometry: Odometry) -> Reason:
    detail = f"{odometry.battery_level.value}, {odometry.battery:.1f} V"
    return Reason(StopReason.LOW_BATTERY, "base", detail)
