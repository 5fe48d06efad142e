"""The first run on a real robot, wheels up: does it report, stop, and turn the way we think?

Every motion is wished here, allowed by `control.stand`, and written by the driver's one writer,
which the running daemon uses too.
"""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import pairwise
from math import degrees, radians

from followerd import clock
from followerd.control.stand import StandGuard
from followerd.errors import DeviceError, LinkLost
from followerd.hw.interfaces import Base, Sensor
from followerd.hw.p2os.parameters import WATCHDOG, Parameters
from followerd.messages import Command, Measurement, Odometry, Scan, Twist
from followerd.runtime import standing_checks as standing
from followerd.runtime.cut_link import CutLink
from followerd.runtime.standing_checks import Check, Outcome, verdict

CONNECTS, SCANS = 20.0, 70.0  # s; a laser may have to boot
LISTENS = 2.0  # s that reports are looked at
POWERS = 3.0  # s for the motors to come on or go off
ROLLS = 1.5  # s of each motion
STILL, STILL_TURN = 0.008, radians(2)  # m/s, rad/s: whole mm/s of each wheel
REACTS = 0.35  # s from a stop to brakes: a command's way, and two reports to show it
BRAKES = 0.3  # m/s², where the base does not say
PRESSES = 15.0  # s for a person to reach a button
PERIOD, LOOK = 0.05, 0.02  # s, between commands; between looks
SCALE = (0.75, 1.33)  # of two ways to know how far it went; a wrong type makes it two
BEYOND, PATIENCE = 0.6, 3.0  # s that a watchdog may take beyond its figure; that we wait for it
STRAY = "look at encoder and motor plugs; do not drive it"

Ask = Callable[[str], Awaitable[bool]]
Tell = Callable[[Check], None]


class DriveCheck:
    """One run over one base and one laser."""

    def __init__(
        self,
        base: Base,
        laser: Sensor,
        link: CutLink,
        ask: Ask,
        tell: Tell,
        *,
        by_hand: bool = True,
    ) -> None:
        """`link` is the base's; `by_hand`: a person is there to press buttons."""
        self.checks: list[Check] = []
        self._base = base
        self._laser = laser
        self._link = link
        self._ask = ask
        self._tell = tell
        self._by_hand = by_hand
        self._guard = StandGuard()
        self._tells_motors = True
        self._why_not = ""  # the guard's reason to stop what was last wished
        self._reports: list[Odometry] = []
        self._scans: list[Scan] = []
        self._tasks: list[asyncio.Task[None]] = []

    async def run(self) -> list[Check]:
        """All checks, in order; motion is left out when the base is not fit for it."""
        self._tasks = [
            asyncio.create_task(self._base.run(self._take_base)),
            asyncio.create_task(self._laser.run(self._take_scan)),
        ]
        try:
            if await self._look() and await self._may_move():
                await self._move()
        except DeviceError as error:
            remedy = error.remedy or "check plug and power"
            self._note(verdict("link to the base", False, error.problem, remedy))
        finally:
            with suppress(LinkLost):
                self._link.mend()
            self._base.drive(Command(clock.now()))
            for task in self._tasks:
                task.cancel()
            await asyncio.gather(*self._tasks, return_exceptions=True)
        return self.checks

    def _take_base(self, measurement: Measurement) -> None:
        if isinstance(measurement, Odometry):
            self._reports.append(measurement)
            self._guard.sense(measurement)

    def _take_scan(self, measurement: Measurement) -> None:
        if isinstance(measurement, Scan):
            self._scans.append(measurement)

    @property
    def _newest(self) -> Odometry:
        return self._reports[-1]

    @property
    def _known(self) -> Parameters | None:
        """The base's parameters, once it takes commands; None of a driver that tells none."""
        ready = getattr(self._base, "caps", None) is not None
        known = getattr(self._base, "parameters", None)
        return known if ready and isinstance(known, Parameters) else None

    async def _until(self, holds: Callable[[], bool], seconds: float, *, of: int = 0) -> bool:
        """Whether it comes to hold; raises what ended the driver it depends on, 0 the base's."""
        deadline = clock.now() + seconds
        while not holds():
            if self._tasks[of].done():
                self._tasks[of].result()
            if clock.now() >= deadline:
                return False
            await clock.sleep(LOOK)
        return True

    def _note(self, check: Check) -> bool:
        """Keep and tell a check; whether it was good."""
        self.checks.append(check)
        self._tell(check)
        return check.outcome is Outcome.OK

    # Looking

    async def _look(self) -> bool:
        """Everything that needs no motion; whether the base is fit to move."""
        await self._until(lambda: self._known is not None and bool(self._reports), CONNECTS)
        known = self._known
        if known is None or not self._reports:
            problem = f"not up within {CONNECTS:.0f} s"
            return self._note(verdict("session", False, problem, "see followerd probe"))
        self._note(standing.session(self._newest.base_id, known))
        first = len(self._reports)
        await clock.sleep(LISTENS)
        heard = self._reports[first:]
        fit = self._note(standing.reports(heard, LISTENS, known))
        fit &= self._note(standing.battery(self._newest))
        fit &= self._note(standing.bumpers(self._newest))
        self._note(standing.sonar(heard))
        await self._look_at_laser()
        return fit

    async def _look_at_laser(self) -> None:
        try:
            await self._until(lambda: bool(self._scans), SCANS, of=1)
        except DeviceError as error:
            remedy = error.remedy or "check plug and power"
            self._note(verdict("laser", False, error.problem, remedy))
            return
        first = len(self._scans)
        await clock.sleep(LISTENS)
        check, where = standing.laser(self._scans[first:], LISTENS)
        self._note(check)
        if where:
            seen = await self._ask(f"Is the nearest thing at the laser's height {where}?")
            remedy = "hold a hand beside it and look again: laser.mount.upside_down, yaw_deg"
            self._note(verdict("laser's mount", seen, "as seen" if seen else "not so", remedy))

    # Moving

    async def _may_move(self) -> bool:
        up = await self._ask(
            "The wheels are going to turn. Do all of them hang free above the ground, with hands"
            " and cables away?"
        )
        if not up:
            problem, remedy = "not confirmed: nothing moved", "put the robot on a stand"
            return self._note(verdict("wheels up", False, problem, remedy))
        # after every connection they are off
        self._tells_motors = not self._newest.motors_enabled
        self._base.enable_motors(True)
        on = await self._until(lambda: self._newest.motors_enabled, POWERS)
        remedy = "release the STOP button, press MOTORS, start again"
        return self._note(verdict("motors on", on, "on" if on else "they stay off", remedy))

    async def _move(self) -> None:
        self._guard.begin()
        speed = self._guard.settings.max_speed_mps
        turn = radians(self._guard.settings.max_turn_degps)
        good = await self._goes("forward", Twist(speed, 0.0), "Did both wheels roll forward?")
        good = good and await self._stops("stop", Twist(-speed, 0.0), keeps_quiet=False)
        good = good and await self._goes(
            "left", Twist(0.0, turn), "Did the right wheel roll forward and the left backward?"
        )
        good = good and await self._stops("no commands", Twist(-speed, 0.0), keeps_quiet=True)
        if good:
            await self._falls_silent(Twist(0.0, -turn))
            await self._button()
        else:
            self._note(Check("other motion", Outcome.LEFT_OUT, "not with what failed"))
        self._base.enable_motors(False)
        await self._go_off("motors off", POWERS, "switch it off")

    async def _roll(self, wish: Twist, seconds: float) -> bool:
        """Wish for a motion for a while; whether the base moves then."""
        end = clock.now() + seconds
        while clock.now() < end:
            command = self._guard.check(wish, clock.now())
            self._why_not = ", ".join(map(str, command.reasons))
            self._base.drive(command)
            await self._until(lambda: False, PERIOD)
        return not _is_still(self._newest)

    async def _stands_at(self, seconds: float) -> float | None:
        """When it was first reported to stand; None: not within `seconds`."""
        stands = await self._until(lambda: _is_still(self._newest), seconds)
        return self._newest.stamp if stands else None

    def _does_not_move(self, name: str) -> bool:
        return self._note(verdict(name, False, self._why_not or "it does not move", STRAY))

    async def _goes(self, name: str, wish: Twist, question: str) -> bool:
        """Whether it goes where it was sent, by the pose, by its speeds and by the eye."""
        begin, first = self._newest, len(self._reports) - 1
        if not await self._roll(wish, ROLLS):
            return self._does_not_move(name)
        self._base.drive(Command(clock.now()))
        await self._stands_at(REACTS + ROLLS)
        moved = ~begin.pose @ self._newest.pose
        turns = wish.v == 0.0
        way = degrees(moved.theta) if turns else 1000 * moved.x
        rolled = sum(
            (after.stamp - before.stamp)
            * (degrees(after.twist.omega) if turns else 1000 * after.twist.v)
            for before, after in pairwise(self._reports[first:])
        )
        unit, what = ("°", "heading") if turns else (" mm", "x")
        detail = f"{what} {way:+.0f}{unit}, by the wheels' speeds {rolled:+.0f}{unit}"
        if way <= 0.0 or rolled <= 0.0:
            return self._note(verdict(name, False, f"the other way: {detail}", STRAY))
        scaled = SCALE[0] < way / rolled < SCALE[1]
        if not self._note(verdict(name, scaled, detail, "a wrong type: set base.model")):
            return False
        seen = await self._ask(question)
        told = "as reported" if seen else "not as reported"
        return self._note(verdict(f"{name}, by eye", seen, told, STRAY))

    async def _stops(self, name: str, wish: Twist, *, keeps_quiet: bool) -> bool:
        """Time to standstill after a stop; or, as if the thinking hung, without any command."""
        if not await self._roll(wish, ROLLS):
            return self._does_not_move(name)
        known, speed, began = self._known, abs(self._newest.twist.v), clock.now()
        allowed = REACTS + speed / (BRAKES if known is None else known.deceleration)
        if keeps_quiet:
            allowed += self._guard.settings.valid_s
        else:
            self._base.drive(Command(began))
        stood = await self._stands_at(allowed + 2.0)
        self._base.drive(Command(clock.now(), emergency=stood is None))
        after = "the last command" if keeps_quiet else "the stop"
        if stood is None:
            problem = f"still rolls {allowed + 2.0:.1f} s after {after}"
            return self._note(verdict(name, False, problem, "switch it off"))
        took = max(stood - began, 0.0)
        detail = f"stands {took:.2f} s after {after} at {speed:.2f} m/s, at most {allowed:.2f} s"
        return self._note(verdict(name, took <= allowed, detail, "see reports above"))

    async def _falls_silent(self, wish: Twist) -> bool:
        """The last resort: what the firmware does when nothing at all comes any more."""
        name = "firmware's watchdog"
        if not await self._roll(wish, 0.5):
            return self._does_not_move(name)
        known = self._known
        due = WATCHDOG if known is None else known.watchdog
        self._link.is_cut = True
        stood = await self._stands_at(due + PATIENCE)
        self._link.mend()
        read = known is not None and known.watchdog_is_read
        figure = f"{'its flash says' if read else 'assumed are'} {due:.1f} s"
        remedy = "set WatchDog with the vendor's flash tool before it drives"
        if stood is None:
            problem = f"still turns {due + PATIENCE:.1f} s after the last byte; {figure}"
            return self._note(verdict(name, False, problem, remedy))
        took = stood - self._link.silent_since
        detail = f"stands {took:.1f} s after the last byte; {figure}"
        return self._note(verdict(name, took <= due + BEYOND, detail, remedy))

    async def _button(self) -> None:
        question = "Will you now press the MOTORS or the STOP button?"
        if self._by_hand and await self._ask(question):
            await self._go_off("button", PRESSES, "it must cut the motors: have it looked at")
        else:
            self._note(Check("button", Outcome.LEFT_OUT, "not pressed"))

    async def _go_off(self, name: str, seconds: float, remedy: str) -> None:
        """Whether the motors do."""
        if not self._tells_motors:
            problem = "this base does not tell whether its motors are on: try to turn a wheel"
            self._note(Check(name, Outcome.LEFT_OUT, problem))
            return
        off = await self._until(lambda: not self._newest.motors_enabled, seconds)
        detail = "motors went off" if off else f"motors still on after {seconds:.0f} s"
        self._note(verdict(name, off, detail, remedy))


def _is_still(report: Odometry) -> bool:
    return abs(report.twist.v) < STILL and abs(report.twist.omega) < STILL_TURN
