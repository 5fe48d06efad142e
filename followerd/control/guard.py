"""The last word before the wheels: what may be sent, and why it differs from the wish."""

from dataclasses import dataclass, field, replace
from math import copysign, degrees, hypot, inf, radians

from followerd.control.clearance import stopping_speed
from followerd.control.freshness import Freshness
from followerd.control.interfaces import View
from followerd.control.limits import GuardSettings
from followerd.control.mode import Permission
from followerd.control.obstacles import Echoes, Obstacles, returns, sees_way, together
from followerd.control.plausible import (
    from_the_future,
    is_finite_wish,
    is_plausible_odometry,
    is_plausible_pose,
    is_plausible_scan,
)
from followerd.control.way import Way
from followerd.geometry import Pose2, wrap_angle
from followerd.messages import (
    Chassis,
    Command,
    Odometry,
    Reason,
    StopReason,
    TurnBy,
    Twist,
    WheelSpeeds,
    Wish,
)

TRIES = 4  # arcs looked at before the robot only turns
INSTANT = 0.001  # s, taken to pass between two checks: what stands keeps trying the way
CRAWL = 0.01  # m/s or rad/s: less is not worth moving for
BEHIND = 0.5  # cosine: a target this far off the way is led, not approached
FROM_MODES = Reason(StopReason.LIMIT, "modes")


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What the guard looks at; what is not known is None."""

    permission: Permission = field(default_factory=Permission)
    base: Pose2 | None = None  # odom_from_base now
    odometry: Odometry | None = None
    view: View | None = None
    target: tuple[float, float] | None = None  # m, the followed person in `odom` now
    claimed: tuple[slice, ...] = ()  # beams of the view that show the confirmed person


class Guard:
    """Only what leaves `check` may reach the wheels."""

    def __init__(self, settings: GuardSettings, freshness: Freshness) -> None:
        self._configured = settings
        self.settings = settings
        self.freshness = freshness
        self._way = Way(settings)
        self._echoes = Echoes(settings.sonar_age_s, settings.sonar_reach_m)
        self._approved = Twist()
        self._approved_at = -inf
        self._looked_at: View | None = None
        self._plausible = False  # what was looked at

    def fit(self, base: Chassis) -> None:
        """The base has told its dimensions; they count where they ask for more room."""
        self.settings = self._configured.fitted(base)
        self._way = Way(self.settings)

    def sense(self, odometry: Odometry) -> None:
        """Remember the sonar readings of a base report that can be."""
        if is_plausible_odometry(odometry):
            self._echoes.sense(odometry)

    def check(
        self,
        wish: Wish | None,
        situation: Situation,
        now: float,
        cause: str = "",
        cause_received: float | None = None,
    ) -> Command:
        """The command for `wish`; it differs only with a reason, and never outlives its data."""
        reasons = self._forbidding(wish, situation, now)
        motion: Wish | None = None
        allowed = Twist()
        base, view = situation.base, situation.view
        if wish is not None and base is not None and view is not None and not reasons:
            turned = _since_report(base, situation.odometry)
            wanted = self._twist(wish, turned)
            capped = self._capped(wanted, situation, view, base, reasons, now)
            obstacles = self._obstacles(view, situation.claimed, base, capped.v, now)
            ramped = self._ramped(capped, now)
            allowed = self._clear(ramped, capped, obstacles, reasons)
            if (allowed.v == ramped.v != capped.v) or (
                allowed.omega == ramped.omega != capped.omega
            ):
                reasons.append(Reason(StopReason.LIMIT, "guard", "acceleration", full_stop=False))
            motion = _as_wished(wish, wanted, ramped, allowed)
            if isinstance(motion, TurnBy):
                motion = self._swept(motion, turned, obstacles, reasons)
        self._approved, self._approved_at = allowed, now
        good_until = min(now + self.settings.valid_s, self.freshness.good_until())
        return Command(
            stamp=now,
            motion=motion,
            expires=now if motion is None else good_until,
            emergency=StopReason.ESTOP in [reason.stop for reason in reasons],
            reasons=tuple(reasons),
            cause=cause,
            cause_received=cause_received,
        )

    def _forbidding(self, wish: Wish | None, situation: Situation, now: float) -> list[Reason]:
        """Why nothing may move at all."""
        permission = situation.permission
        if not permission.move:
            return list(permission.reasons) or [Reason(StopReason.DISARMED)]
        if reasons := self.freshness.stale(now):
            return list(reasons)
        odometry, view = situation.odometry, situation.view
        absurd = from_the_future(self.freshness.newest, now)
        if wish is not None and not is_finite_wish(wish):
            absurd.append("wish")
        if odometry is not None and not is_plausible_odometry(odometry):
            absurd.append("odometry")
        if view is not None and not self._is_plausible(view):
            absurd.append("scan")
        if situation.base is not None and not is_plausible_pose(situation.base):
            absurd.append("position")
        if situation.base is None or odometry is None:
            return [Reason(StopReason.ODOMETRY_STALE, "odometry", "position unknown")]
        if view is None:
            return [Reason(StopReason.SCAN_STALE, "scan", "taken at an unknown place")]
        return [Reason(StopReason.ABSURD_DATA, name) for name in absurd]

    def _is_plausible(self, view: View) -> bool:
        if view is not self._looked_at:
            self._looked_at = view
            self._plausible = is_plausible_pose(view.base) and is_plausible_scan(
                view.scan, self.settings.max_missing_share
            )
        return self._plausible

    def _twist(self, wish: Wish, turned: float) -> Twist:
        """The wish as speeds; `turned` is the angle since the report that a turn counts from."""
        if isinstance(wish, Twist):
            return wish
        if isinstance(wish, WheelSpeeds):
            difference = wish.right - wish.left
            return Twist(0.5 * (wish.left + wish.right), difference / self.settings.track_m)
        fastest = radians(self.settings.max_turn_degps)
        rest = wish.angle if wish.added else wish.angle - turned
        return Twist(wish.v, min(max(rest / self.settings.valid_s, -fastest), fastest))

    def _capped(
        self,
        wanted: Twist,
        situation: Situation,
        view: View,
        base: Pose2,
        reasons: list[Reason],
        now: float,
    ) -> Twist:
        """Within all caps that need no look at the way."""
        s, v = self.settings, wanted.v
        if v != 0.0 and sees_way(view.scan, v):
            v = _slower(v, s.speed_cap, reasons, StopReason.LIMIT, "guard", "speed")
            if situation.permission.drive is None:  # a hand need not know how far anybody is
                v = self._near_target(v, situation.target, base, reasons)
            v = self._near_others(v, situation.claimed, view, reasons)
        elif v != 0.0:
            v = self._unseen(v, reasons, now)
        allowed = situation.permission.max_speed
        for why in situation.permission.reasons or (FROM_MODES,):
            v = _slower(v, allowed, reasons, why.stop, why.device, why.detail)
        for late in self.freshness.ageing(s.slow_after, now):
            v = _slower(v, s.slow_speed_mps, reasons, late.stop, late.device, late.detail)
        fastest = radians(s.max_turn_degps)
        omega = _slower(wanted.omega, fastest, reasons, StopReason.LIMIT, "guard", "turn rate")
        return Twist(v, omega)

    def _ramped(self, twist: Twist, now: float) -> Twist:
        """Growing gently from what was approved last; slowing down is free."""
        s, start = self.settings, self._approved
        dt = min(max(now - self._approved_at, INSTANT), s.valid_s)
        return Twist(
            _grown(start.v, twist.v, s.accel_mps2 * dt),
            _grown(start.omega, twist.omega, radians(s.turn_accel_degps2) * dt),
        )

    def _near_target(
        self, v: float, target: tuple[float, float] | None, base: Pose2, reasons: list[Reason]
    ) -> float:
        """No speed toward a person who is near, or at an unknown distance."""
        s = self.settings
        if target is None:
            return _slower(v, 0.0, reasons, StopReason.RANGE_UNKNOWN, "tracker")
        x, y = (~base).apply_point(*target)
        distance = hypot(x, y)
        if copysign(x, x * v) < -BEHIND * distance:
            return v  # the robot leads
        limit, why = (distance - s.min_target_m) / s.approach_s, f"followed, at {distance:.2f} m"
        return _slower(v, limit, reasons, StopReason.PERSON_TOO_CLOSE, "tracker", why)

    def _near_others(
        self, v: float, claimed: tuple[slice, ...], view: View, reasons: list[Reason]
    ) -> float:
        """Slowly past whoever else stands near the way."""
        s, seen = self.settings, view.clusters
        if abs(v) <= s.person_speed_mps:
            return v
        others = seen.leg_like & (seen.nearest < s.person_within_m)
        if not others.any():
            return v
        others &= (v * seen.centre[:, 0] > 0) & (abs(seen.centre[:, 1]) < s.person_aside_m)
        if view.mapped is not None:
            others &= ~view.mapped
        for beams in claimed:
            others &= (seen.last < beams.start) | (seen.first >= beams.stop)
        if not others.any():
            return v
        why = f"someone else at {seen.nearest[others].min():.2f} m"
        return _slower(v, s.person_speed_mps, reasons, StopReason.PERSON_TOO_CLOSE, "laser", why)

    def _unseen(self, v: float, reasons: list[Reason], now: float) -> float:
        """Where the laser does not look, only as far as the sonar has just heard."""
        s, heard = self.settings, self._echoes.along(v, now)
        if len(heard) < s.rear_discs:
            return _slower(v, 0.0, reasons, StopReason.REAR_UNSEEN, "sonar")
        limit = stopping_speed(min(heard) - s.rear_margin_m, s.reaction_s, s.deceleration_mps2)
        why = f"{min(heard):.2f} m {'behind' if v < 0 else 'ahead'}"
        v = _slower(v, limit, reasons, StopReason.OBSTACLE, "sonar", why)
        why = f"{'backward' if v < 0 else 'unseen'} speed"
        return _slower(v, s.max_reverse_mps, reasons, StopReason.LIMIT, "guard", why)

    def _obstacles(
        self, view: View, claimed: tuple[slice, ...], base: Pose2, v: float, now: float
    ) -> Obstacles:
        """Everything near enough to matter at speed `v`, seen from the robot now."""
        s = self.settings
        is_seen = sees_way(view.scan, v)
        margins = (s.margin_m, s.target_margin_m) if is_seen else (s.rear_margin_m,) * 2
        seen = returns(view.points, ~base @ view.base, claimed, margins, self._way.reach(v))
        return together(seen, self._echoes.obstacles(base, s.sonar_margin_m, now))

    def _clear(
        self, twist: Twist, capped: Twist, obstacles: Obstacles, reasons: list[Reason]
    ) -> Twist:
        """Slow enough to stop before anything in the swept way.

        While the speed still ramps up to `capped` its turn rate sweeps a tighter arc than the one
        that is meant. Where that one is free and the tight one is not the turn waits for the speed.
        """
        omega = twist.omega
        if omega != 0.0:
            limit, why = self._free_turn(omega, obstacles), "beside the robot, in its turn"
            omega = _slower(omega, limit, reasons, StopReason.OBSTACLE, "laser", why)
        v, why = self._along(twist.v, omega, omega, obstacles)
        if omega != 0.0 and abs(v) < abs(twist.v) < abs(capped.v):
            eased = omega * twist.v / capped.v
            start = omega * self.settings.start_mps / abs(capped.v)
            farther, reason = self._along(twist.v, eased, start, obstacles)
            if abs(farther) > abs(v):
                v, omega, why = farther, eased, reason
        v = _slower(twist.v, abs(v), reasons, StopReason.OBSTACLE, "laser", why)
        return Twist(v, omega)

    def _free_turn(self, omega: float, obstacles: Obstacles) -> float:
        """The turn rate, rad/s, that the room on that side allows.

        A robot that stands, or hardly turns, needs room for `start_degps`: it does not creep up to
        its margin.
        """
        limit, slow = self._way.free_turn(omega, obstacles), radians(self.settings.start_degps)
        stands = abs(self._approved.v) < self.settings.start_mps
        return 0.0 if stands and max(limit, abs(self._approved.omega)) < slow else limit

    def _swept(
        self, turn: TurnBy, turned: float, obstacles: Obstacles, reasons: list[Reason]
    ) -> TurnBy:
        """A turn that ends before the robot's body touches something."""
        rest = turn.angle - turned
        free = self._way.free_angle(rest, obstacles)
        if turn.added or abs(rest) <= free:
            return turn
        why = f"free turn {degrees(free):.0f} degrees"
        reasons.append(Reason(StopReason.OBSTACLE, "laser", why, full_stop=False))
        return replace(turn, angle=turned + copysign(free, rest))

    def _along(
        self, v: float, omega: float, start_omega: float, obstacles: Obstacles
    ) -> tuple[float, str]:
        """The speed up to `v` that may be driven while turning at `omega`, and what limits it.

        A lower speed at the same turn rate sweeps another arc: what is allowed is checked again. A
        robot that stands, or crawls, needs room for `start_mps` at `start_omega`: it neither creeps
        up to its margin nor, by arcs as tight as a crawl makes them, past it.
        """
        why, slow = "", self.settings.start_mps
        if v != 0.0 and max(abs(v), abs(self._approved.v)) < slow:
            limit, why = self._way.free_speed(Twist(copysign(slow, v), start_omega), obstacles)
            if limit < slow:
                return 0.0, why
        for _ in range(TRIES):
            if v == 0.0:
                break
            limit, why = self._way.free_speed(Twist(v, omega), obstacles)
            if self._approved.v == 0.0 and limit < slow:
                limit = 0.0
            if abs(v) <= limit:
                break
            # an arc of lower speed may be a little less free
            v = _slower(v, limit if omega == 0.0 else 0.95 * limit, [], StopReason.OBSTACLE)
        else:
            v = 0.0
        return v, why


def _since_report(base: Pose2, odometry: Odometry | None) -> float:
    """Angle turned since the base's newest report, rad."""
    return 0.0 if odometry is None else wrap_angle(base.theta - odometry.pose.theta)


def _as_wished(wish: Wish, wanted: Twist, ramped: Twist, allowed: Twist) -> Wish | None:
    """What is allowed, in the words of the wish where they still hold; None is a stop."""
    if allowed == Twist():
        return None
    if allowed == wanted:
        return wish
    if isinstance(wish, TurnBy) and allowed.omega == ramped.omega != 0.0:
        return replace(wish, v=allowed.v)  # the base ramps its turns itself
    return allowed


def _slower(
    value: float,
    limit: float,
    reasons: list[Reason],
    stop: StopReason,
    device: str = "",
    detail: str = "",
) -> float:
    """`value` no larger than `limit` in size; below a crawl it is a stop; says so in `reasons`."""
    if abs(value) <= limit:
        return value
    # written so that a limit that is not a number stops
    limit = limit if limit >= CRAWL else 0.0
    reasons.append(Reason(stop, device, detail, full_stop=limit == 0.0))
    return limit if value > 0 else -limit


def _grown(before: float, wanted: float, step: float) -> float:
    """`wanted`, but grown by no more than `step` away from zero."""
    grown = min(abs(wanted), (abs(before) if before * wanted > 0 else 0.0) + step)
    return grown if wanted >= 0 else -grown
