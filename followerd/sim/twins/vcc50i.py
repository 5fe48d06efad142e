"""The twin of a Canon VC-C50i or VC-C4: power, control modes, busy and error answers, motion.

After power-on it is under its remote control's control, tilts by ±30° only, and does not know
where it points. Its answers leave some time after the command; a command that comes meanwhile is
lost, as on the device. Not simulated: exposure, presets, menu, cascades, notes of ends and
events, and the commands outside `commands.Cmd`. (VC-C50i/VC-C50iR Programmer's Manual; times that
it does not give are guesses, marked so.)
"""

from math import inf

import numpy as np

from followerd.geometry import Camera
from followerd.hw.vcc50i.commands import (
    ORIGIN,
    Cmd,
    Status,
    pan_angle,
    position_data,
    position_of,
    tilt_angle,
    zoom_factor,
)
from followerd.hw.vcc50i.models import MODELS, SLOWEST
from followerd.hw.vcc50i.protocol import (
    BAUD,
    FROM_HOST,
    Answer,
    Errors,
    FrameDecoder,
    Request,
    digits,
    number,
)
from followerd.sim.twins.vcc50i_head import Head

ANSWERS_AFTER = 0.02  # s, a guess; the manual promises 0.3
POWERS_UP = 4.5  # s, clients' figure
STARTS = 2.0  # s from mains to the first answer, a guess
TILT_AT_FIRST = (-267, 267)  # steps
RESOLUTION = 1e-9  # s
IN_ANY_MODE = (Cmd.STATUS, Cmd.CONTROL)
OF_THE_HEAD = (Cmd.MOVE, Cmd.POSITION, Cmd.RUN, Cmd.HOME)
NEEDS_HOME = (Cmd.MOVE, Cmd.POSITION)
NAMES = {"vc-c50i": b"C50i ", "vc-c4": b"VC-C4"}  # the second is a guess


class _Refusal(Exception):
    """The command is not executed."""

    def __init__(self, errors: Errors) -> None:
        super().__init__()
        self.errors = errors | Errors.BUSY


class Vcc50iTwin:
    """Implements sim.interfaces.Twin; `aimed` tells where its camera looks."""

    def __init__(
        self,
        rng: np.random.Generator,
        *,
        model: str = "vc-c50i",
        is_on: bool = True,
        is_local: bool = True,
        knows_home: bool = False,
        baud: int = BAUD,
        answers_after: float = ANSWERS_AFTER,
    ) -> None:
        self.baud = baud
        self.limits = MODELS[model]
        self.head = Head(self.limits, rng)
        self.head.knows_home = knows_home
        self.menu_is_open = False
        self.obeyed: list[Request] = []  # commands that were executed
        self._name = NAMES[model]
        self._is_on = is_on
        self._is_local = is_local
        self._answers_after = answers_after
        self._tilt_range = TILT_AT_FIRST
        self._up_at = -inf  # s, when it hears
        self._powered_at: float | None = None  # s, when its power will be on
        self._decoder = FrameDecoder(FROM_HOST)
        self._answer: tuple[float, bytes] | None = None  # when it leaves, s

    # What the line and the camera call

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host; while an answer is due or it starts, they are lost."""
        self._advance(now)
        for frame in self._decoder.feed(data):
            request = Request.parse(frame)
            if request is not None and self._answer is None and now >= self._up_at:
                self._answer = (now + self._answers_after, self._obey(request, now).to_bytes())

    def step(self, now: float) -> bytes:
        """The answer that starts to leave now."""
        self._advance(now)
        if self._answer is None or self._answer[0] > now + RESOLUTION:
            return b""
        data, self._answer = self._answer[1], None
        return data

    def wake_at(self) -> float:
        """When an answer is due."""
        return inf if self._answer is None else self._answer[0]

    def reboot(self, now: float) -> None:
        """Mains off and on: it stands where it is, and forgets all else."""
        self._advance(now)
        self.head.lose_power()
        self._is_on, self._is_local, self._powered_at = True, True, None
        self._tilt_range = TILT_AT_FIRST
        self._answer = None
        self._decoder = FrameDecoder(FROM_HOST)
        self._up_at = now + STARTS

    def aimed(self, camera: Camera, now: float) -> Camera:
        """`camera` (as mounted, head at home, zoomed wide) as it really looks at `now`."""
        self._advance(now)
        return camera.turned(
            pan_angle(self.head.pan.position),
            tilt_angle(self.head.tilt.position),
            zoom_factor(self.head.lens.position, self.limits.zoom_tele, self.limits.zoom_ratio),
        )

    # What happens to it

    def take_by_remote(self) -> None:
        """Somebody gives control back to the remote control."""
        self._is_local = True

    def _advance(self, now: float) -> None:
        self.head.advance(now)
        if self._powered_at is not None and now + RESOLUTION >= self._powered_at:
            self._is_on, self._powered_at = True, None

    # Commands

    def _obey(self, request: Request, now: float) -> Answer:
        try:
            self._check_mode(request)
            data = self._execute(request, now)
        except _Refusal as refusal:
            return Answer(refusal.errors)
        self.obeyed.append(request)
        return Answer(data=data)

    def _check_mode(self, request: Request) -> None:
        if request.command in IN_ANY_MODE:
            return
        if self._is_local or not (self._is_on or request.command == Cmd.POWER):
            raise _Refusal(Errors.MODE)
        if request.command in OF_THE_HEAD and self.head.finds_home:
            raise _Refusal(Errors.BUSY)
        runs = request.command == Cmd.RUN and request.parameters != b"0"
        if (runs or request.command in NEEDS_HOME) and not self.head.knows_home:
            if request.command != Cmd.POSITION:
                self.head.find_home(then_back=True)  # it moves although it refuses
            raise _Refusal(Errors.MODE)

    def _execute(self, request: Request, now: float) -> bytes:
        match Cmd(request.command) if request.command in list(Cmd) else None:
            case Cmd.STATUS:
                return self._status_digits(request.parameters)
            case Cmd.CONTROL:
                if self.menu_is_open:
                    raise _Refusal(Errors.MODE)
                self._is_local = bool(self._choice(request, b"01"))
            case Cmd.POWER:
                self._switch(bool(self._choice(request, b"01")), now)
            case Cmd.NAME:
                return self._name
            case Cmd.PAN_SPEED:
                speed = self._value(request.parameters, 3, (SLOWEST, self.limits.pan_speed))
                self.head.set_speeds(speed, self.head.tilt_speed)
            case Cmd.TILT_SPEED:
                speed = self._value(request.parameters, 3, (SLOWEST, self.limits.tilt_speed))
                self.head.set_speeds(self.head.pan_speed, speed)
            case Cmd.SPEED:
                speeds = self.head.pan_speed, self.head.tilt_speed
                return digits(round(speeds[self._choice(request, b"01")]), 3)
            case Cmd.SPEED_LIMITS:
                ends = (SLOWEST, self.limits.pan_speed, SLOWEST, self.limits.tilt_speed)
                return digits(ends[self._choice(request, b"0123")], 3)
            case Cmd.ANGLE_LIMITS:
                angles = (*self.limits.pan, *self.limits.tilt)
                return digits(ORIGIN + angles[self._choice(request, b"0123")], 4)
            case Cmd.RANGE:
                self._set_range(request.parameters)
            case Cmd.POSITION:
                pan, tilt = self.head.counted
                return position_data(round(pan), round(tilt))
            case Cmd.INITIALISE:
                self.head.find_home(then_back=bool(self._choice(request, b"01")))
            case Cmd.HOME | Cmd.MOVE | Cmd.RUN:
                self._turn(request)
            case Cmd.FOCUS:
                self._choice(request, b"01")
            case Cmd.ZOOM_RATIO:
                return digits(round(self.limits.zoom_ratio), 2)
            case Cmd.ZOOM_POSITION:
                tele = self.limits.zoom_tele
                here = min(max(round(self.head.lens.position), 0), tele)
                return digits(tele if self._choice(request, b"03") else here, 4)
            case Cmd.ZOOM_RUN:
                self._choice(request, b"0")
                self.head.lens.halt()
            case Cmd.ZOOM:
                goal = self._value(request.parameters, 4, (0, self.limits.zoom_tele))
                if self.head.lens.runs:
                    raise _Refusal(Errors.BUSY)
                self.head.lens.go(goal, self.head.lens.speed)
            case _:
                raise _Refusal(Errors.COMMAND)
        return b""

    def _turn(self, request: Request) -> None:
        if request.command == Cmd.RUN and self._choice(request, b"01234") == 0:
            self.head.halt()
            return
        goal = (0, 0)
        if request.command == Cmd.MOVE:
            where = position_of(request.parameters)
            if where is None or not (self._is_in_range(*where)):
                raise _Refusal(Errors.PARAMETER)
            goal = where
        elif request.command == Cmd.RUN:
            goal = self._end_of_run(request)
        if self.head.turns:
            raise _Refusal(Errors.BUSY)
        if request.command == Cmd.HOME and not self.head.knows_home:
            self.head.find_home(then_back=False)
        else:
            self.head.go(*goal)

    def _end_of_run(self, request: Request) -> tuple[int, int]:
        pan, tilt = (round(steps) for steps in self.head.counted)
        left, right = self.limits.pan
        low, high = self._tilt_range
        ends = ((right, tilt), (left, tilt), (pan, high), (pan, low))
        return ends[self._choice(request, b"1234")]

    def _is_in_range(self, pan: int, tilt: int) -> bool:
        (left, right), (low, high) = self.limits.pan, self._tilt_range
        return left <= pan <= right and low <= tilt <= high

    def _switch(self, on: bool, now: float) -> None:
        if self._powered_at is not None:
            raise _Refusal(Errors.BUSY)
        if on and not self._is_on:
            self._powered_at = now + POWERS_UP
        elif not on:
            self._is_on = False

    def _set_range(self, parameters: bytes) -> None:
        lowest, highest = number(parameters[1:5]), number(parameters[5:])
        if len(parameters) != 9 or lowest is None or highest is None or lowest > highest:
            raise _Refusal(Errors.PARAMETER)
        ends = lowest - ORIGIN, highest - ORIGIN
        limits = {b"0": self.limits.pan, b"1": self.limits.tilt}.get(parameters[:1])
        if limits is None or ends[0] < limits[0] or ends[1] > limits[1]:
            raise _Refusal(Errors.PARAMETER)
        if limits is self.limits.tilt:
            self._tilt_range = ends

    def _status_digits(self, parameters: bytes) -> bytes:
        if parameters not in (b"", b"0"):
            raise _Refusal(Errors.PARAMETER)
        head = self.head
        status = Status(0)
        status |= Status.TILTING * (head.tilt.runs or head.finds_home)
        status |= Status.PANNING * (head.pan.runs or head.finds_home)
        status |= Status.ZOOMING * head.lens.runs
        status |= Status.CAMERA_OFF * (not self._is_on)
        status |= Status.NOT_INITIALISED * (not head.knows_home)
        if not parameters:
            return digits(status, 3)
        status |= Status.LOCAL * self._is_local | Status.MENU * self.menu_is_open
        return digits(status, 5)

    def _choice(self, request: Request, choices: bytes) -> int:
        """Which of the one-digit parameters it is."""
        if len(request.parameters) != 1 or request.parameters not in choices:
            raise _Refusal(Errors.PARAMETER)
        return choices.index(request.parameters)

    def _value(self, parameters: bytes, count: int, limits: tuple[int, int]) -> int:
        value = number(parameters)
        if value is None or len(parameters) != count or not limits[0] <= value <= limits[1]:
            raise _Refusal(Errors.PARAMETER)
        return value
