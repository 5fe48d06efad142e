"""What the base is told, overheard on its line."""

from dataclasses import replace
from math import radians

from followerd.hw.p2os.commands import Cmd, Request, split_bytes
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.messages import Twist

STOPS = (Cmd.STOP, Cmd.E_STOP)
VEL2_STEP = 0.02  # m/s per unit, of the simulated base
TRACK = 0.357  # m


class Told:
    """The speeds that are set in the base; a turn by an angle does not count as one."""

    def __init__(self, baud: int) -> None:
        """`baud`: of the line once it is connected."""
        self.history: list[tuple[float, Twist]] = []  # s of the last byte
        self._baud = baud
        self._now = Twist()

    def hear(self, device: str, data: bytes, now: float) -> None:
        """A line watcher: bytes that begin to leave `now`."""
        if device != "base-sent":
            return
        for packet in PacketDecoder().feed(data):
            if (then := _after(self._now, Request.parse(packet.payload))) is not None:
                self._now = then
                self.history.append((now + 10 * len(data) / self._baud, then))

    def at(self, stamp: float) -> Twist:
        """What it was told last at `stamp`."""
        return next((twist for t, twist in reversed(self.history) if t <= stamp), Twist())


def _after(before: Twist, request: Request) -> Twist | None:
    """What is set behind a command; None when it sets no speed."""
    if request.number in STOPS:
        return Twist()
    if request.number == Cmd.VEL:
        return replace(before, v=request.integer / 1000)
    if request.number == Cmd.RVEL:
        return replace(before, omega=radians(request.integer))
    if request.number == Cmd.VEL2:
        left, right = [VEL2_STEP * unit for unit in split_bytes(request.integer)]
        return Twist(0.5 * (left + right), (right - left) / TRACK)
    return None
