"""A target's direction carried on by its image's flow (Motai, Jha and Kruse 2012, eq. 21-45)."""

from followerd.estimation.direction import Look
from followerd.estimation.pan_flow import Pair, camera_flow, following_turn


class Of:
    """Eq. 21-45: the last place carried on by the target's own flow; no memory, no lag."""

    def __init__(self) -> None:
        self._look: Look | None = None
        self._turn: Pair = (0.0, 0.0)  # rad/s, of a head that follows
        self._angles: Pair = (0.0, 0.0)

    def step(self, look: Look) -> None:
        """See Predictor."""
        self.take(look.angles, look)

    def take(self, direction: Pair, look: Look) -> None:
        """The target was seen at `direction`, which is that of `look`."""
        before, self._look = self._look, look
        self._angles = direction
        if before is None:
            return
        dt = look.stamp - before.stamp
        flow = look.flow or ((look.x - before.x) / dt, (look.y - before.y) / dt)  # eq. 31-32
        turn = (look.pan - before.pan) / dt, (look.tilt - before.tilt) / dt
        x, y = 0.5 * (look.x + before.x), 0.5 * (look.y + before.y)
        camera = camera_flow(x, y, turn, look.focal, look.ahead, look.depth)
        own = flow[0] - camera[0], flow[1] - camera[1]  # eq. 35-36
        self._turn = following_turn(x, y, own, look.focal)

    def ahead(self, dt: float) -> Pair:
        """See Predictor."""
        return self._angles[0] + dt * self._turn[0], self._angles[1] + dt * self._turn[1]
