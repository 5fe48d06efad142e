"""The world: one robot among walls, furniture and walkers. It has the robot's body and its view."""

from collections.abc import Sequence
from functools import cached_property
from math import atan2, cos, hypot, pi, radians, sin, sqrt, tau

import numpy as np
import numpy.typing as npt

from followerd.geometry import Array, Camera, Pose2, wrap_angle
from followerd.messages import Box, Pixels, Twist
from followerd.sim.people import LEG_RADIUS, Motion, Pedestrian, Walker, legs
from followerd.sim.place import LASER_HEIGHT, Place
from followerd.sim.raycast import cast
from followerd.sim.render import Draw, Renderer, Shot
from followerd.sim.scenarios import Block, Column, Scenario
from followerd.sim.truth import Actor, Truth
from followerd.sim.wardrobe import dress

TICK = 0.05  # s, grid on which contacts are looked for and slip changes
BODY_RADIUS = 0.2  # m, of a person
LEAVES = 0.05  # m of gap after which a contact has ended
CAUSES = 0.05  # m/s of approach that makes a contact the robot's own
NOTICED = 1.0  # s in view after which the robot must have seen a person
SLIP_MEMORY = 0.8  # correlation of the slip from tick to tick
SONAR_RANGE = 5.0  # m
STALLS = 0.02  # m/s against an obstacle that the base feels as a stall
FIXED = -1  # in contacts: the fixed part of the world
STANDING = Twist()
SONAR_CONE = np.radians(np.arange(-15.0, 15.1, 2.5))


class World:
    """A scenario come to life; implements Body and Scene. It begins at the first `advance`."""

    def __init__(self, scenario: Scenario, rng: np.random.Generator) -> None:
        self.scenario = scenario
        people_rng, balls_rng, wheel_rng, light_rng = rng.spawn(4)
        self.place = Place(scenario)
        self.people = dress(scenario.people, people_rng)
        self.walkers: list[Walker] = [*self.people]
        for ball, ball_rng in zip(
            scenario.balls, balls_rng.spawn(len(scenario.balls)), strict=True
        ):
            self.walkers.append(Walker(ball, ball_rng))
        self._target = next(i for i, w in enumerate(self.walkers) if w.mover.target)
        for person in self.people:
            if person.crosses is not None:
                person.cross(self.walkers[self._target], scenario.duration_s)
        self._light_rng = light_rng
        self.draw: Draw = lambda shot, omega: self._renderer.colour(shot, omega)
        start = scenario.robot
        self.pose = Pose2(start.x_m, start.y_m, radians(start.yaw_deg))  # world_from_base
        self.twist = Twist()
        self._begun: float | None = None
        self._elapsed = 0.0
        self._ticks = 0
        self._rng = wheel_rng
        self._wheels = (0.0, 0.0)  # m/s, as driven
        self._travel = [0.0, 0.0]  # m, as the encoders say
        self._size = 1.0 + start.wheel_error * wheel_rng.standard_normal(2)
        self._slip = np.zeros(2)
        self._grip = (float(self._size[0]), float(self._size[1]))  # true speed / encoder speed
        self._fixed = self.place.nearest(self.pose.x, self.pose.y)  # distance, direction
        self._free = self._fixed[0] - start.radius_m  # m to move before it needs another look
        self._against: dict[int, tuple[float, float]] = {}  # walkers touched: direction there
        self._touched: set[int] = set()  # contacts being counted; FIXED for the fixed part
        self._held = False
        self._seen_for = [0.0] * len(self.walkers)
        self._collisions = 0
        self._bumped = 0
        self._min_approached = float("inf")
        self._min_any = float("inf")

    @cached_property
    def _renderer(self) -> Renderer:
        """Paints its textures when the first picture is asked for (0.3 to 0.6 s)."""
        return Renderer(self.scenario, self.walkers, self._light_rng)

    def paint(self) -> Draw:
        """What draws its pictures, with the textures painted now rather than for the first one."""
        return self._renderer.colour

    @property
    def now(self) -> float:
        """Loop time up to which the world has moved, s."""
        return (self._begun or 0.0) + self._elapsed

    @property
    def elapsed(self) -> float:
        """Time since the scenario began, s."""
        return self._elapsed

    # --- the robot's body -------------------------------------------------------------------

    @property
    def wheel_travel(self) -> tuple[float, float]:
        """Path rolled by the left and right wheel since the start, as the encoders say, m."""
        return self._travel[0], self._travel[1]

    @property
    def blocked(self) -> tuple[bool, bool]:
        """Whether the left, right wheel is held by an obstacle."""
        return self._held, self._held

    @property
    def bumpers(self) -> tuple[int, int]:
        """Pressed front and rear segments: bit 0 the leftmost, bit 4 the rightmost seen forward."""
        front = rear = 0
        for x, y in self._contacts():
            bearing = wrap_angle(atan2(y, x) - self.pose.theta)
            if abs(bearing) <= pi / 2:
                front |= 1 << min(4, int((pi / 2 - bearing) / (pi / 5)))
            else:
                rear |= 1 << min(4, int((bearing % tau - pi / 2) / (pi / 5)))
        return front, rear

    def drive(self, left: float, right: float) -> None:
        """Wheel surface speeds from now on, m/s."""
        if self.scenario.task != "watch":
            self._wheels = (left, right)

    def advance(self, now: float) -> None:
        """Move the whole world on to loop time `now`; the first call is the scenario's start."""
        if self._begun is None:
            self._begun = now
            self._tick()
        until = now - self._begun
        while (due := self._ticks * TICK) <= until:
            self._move(due - self._elapsed)
            self._elapsed = due
            self._tick()
        if until > self._elapsed:
            self._move(until - self._elapsed)
            self._elapsed = until

    def _move(self, dt: float) -> None:
        """Roll at the present wheel speeds for `dt`, unless something is in the way."""
        left, right = self._wheels
        if not (left or right):
            self.twist, self._held = STANDING, False
            return
        true_left, true_right = left * self._grip[0], right * self._grip[1]
        v = 0.5 * (true_left + true_right)
        omega = (true_right - true_left) / self.scenario.robot.track_m
        self._free -= abs(v) * dt
        if self._free <= 0.0:
            self._fixed = self.place.nearest(self.pose.x, self.pose.y)
            self._free = self._fixed[0] - self.scenario.robot.radius_m - abs(v) * dt
        pressed = self._is_pressed(v)
        self._held = pressed and abs(v) > STALLS
        if pressed:  # a round footprint can still turn on the spot
            v, common = 0.0, 0.5 * (left + right)
            left, right = left - common, right - common
        self.twist = Twist(v, omega)
        self.pose = self.pose.moved(v, omega, dt)
        self._travel[0] += left * dt
        self._travel[1] += right * dt

    def _is_pressed(self, v: float) -> bool:
        """Whether moving at speed `v` presses against something touched."""
        touched = self._contacts()
        if not touched:
            return False
        ahead_x, ahead_y = v * cos(self.pose.theta), v * sin(self.pose.theta)
        return any(ahead_x * x + ahead_y * y > 0.05 * abs(v) for x, y in touched)

    def _contacts(self) -> list[tuple[float, float]]:
        """Unit vectors (world) to everything the footprint touches."""
        touched = list(self._against.values())
        if self._free <= 0.0:
            touched.append(self._fixed[1:])
        return touched

    def put(self, *things: Block | Column) -> None:
        """Things that were not there before, instead of those put there last."""
        old = self.scenario
        boxes = tuple(thing for thing in things if isinstance(thing, Block))
        columns = tuple(thing for thing in things if isinstance(thing, Column))
        more = {"boxes": (*old.boxes, *boxes), "columns": (*old.columns, *columns)}
        self.place = Place(old.model_copy(update=more))
        self._fixed = self.place.nearest(self.pose.x, self.pose.y)
        self._free = self._fixed[0] - old.robot.radius_m

    # --- what happens on the grid of TICK -----------------------------------------------------

    def _tick(self) -> None:
        self._ticks += 1
        self._change_grip()
        self._notice_contact(FIXED, self._free > 0.0, self._free > LEAVES, caused=True)
        if self.walkers:
            self._meet_walkers()

    def _change_grip(self) -> None:
        """Slip wanders: first-order noise with the scenario's sigma."""
        fresh = sqrt(1.0 - SLIP_MEMORY**2) * self.scenario.robot.slip
        self._slip = SLIP_MEMORY * self._slip + fresh * self._rng.standard_normal(2)
        left, right = (self._size * (1.0 - self._slip)).tolist()
        self._grip = (left, right)

    def _meet_walkers(self) -> None:
        """Who is seen, who is near, who touches whom."""
        motions = [walker.at(self._elapsed) for walker in self.walkers]
        seen = self._who_is_seen(motions)
        c, s = cos(self.pose.theta), sin(self.pose.theta)
        for i, (walker, motion) in enumerate(zip(self.walkers, motions, strict=True)):
            if not isinstance(walker, Pedestrian):
                continue
            dx, dy = motion.x - self.pose.x, motion.y - self.pose.y
            distance = max(1e-9, hypot(dx, dy))
            in_front = c * dx + s * dy > 0.0
            self._seen_for[i] = self._seen_for[i] + TICK if seen[i] and in_front else 0.0
            approach = self.twist.v * (c * dx + s * dy) / distance
            caused = approach > CAUSES and self._seen_for[i] >= NOTICED
            self._min_any = min(self._min_any, distance)
            if caused:
                self._min_approached = min(self._min_approached, distance)
            gap = distance - self.scenario.robot.radius_m - BODY_RADIUS
            self._notice_contact(i, gap > 0.0, gap > LEAVES, caused)
            if gap <= 0.0:
                self._against[i] = (dx / distance, dy / distance)
            else:
                self._against.pop(i, None)

    def _who_is_seen(self, motions: list[Motion]) -> list[bool]:
        """For each walker, whether the straight view from the robot is free."""
        bodies = [
            (m.x, m.y, BODY_RADIUS if isinstance(walker, Pedestrian) else 0.0)
            for walker, m in zip(self.walkers, motions, strict=True)
        ]
        return self.place.sees(self.pose.x, self.pose.y, bodies)

    def _notice_contact(self, what: int, apart: bool, gone: bool, caused: bool) -> None:
        """Count a contact once, from touching until it has gone."""
        if not apart and what not in self._touched:
            self._touched.add(what)
            self._collisions += caused
            self._bumped += not caused
        elif gone:
            self._touched.discard(what)

    # --- what its sensors see -----------------------------------------------------------------

    def sonar(self, discs: Sequence[Pose2]) -> list[float]:
        """Range in m of each disc (`base_from_disc`), 5.0 without echo."""
        if not discs:
            return []
        poses = [self.pose @ disc for disc in discs]
        angles = (np.array([pose.theta for pose in poses])[:, None] + SONAR_CONE).ravel()
        origins = np.repeat([(pose.x, pose.y) for pose in poses], SONAR_CONE.size, axis=0)
        rays = np.array([np.cos(angles), np.sin(angles)]).T
        segments, _ = self.place.laser
        heard = cast(origins, rays, segments, self._cylinders(self._elapsed))
        nearest: list[float] = heard.reshape(len(discs), -1).min(axis=1).tolist()
        return [min(SONAR_RANGE, found) for found in nearest]

    def ranges(self, base_from_laser: Pose2, bearings: Array, ages: Array) -> Array:
        """True ranges (N,) of beams measured `ages` seconds before the world's now; inf = none."""
        v, omega = self.twist.v, self.twist.omega
        turn = -omega * ages
        half = self.pose.theta + 0.5 * turn
        x = self.pose.x - v * ages * np.cos(half)  # the chord is the arc to 1e-4 in a scan's time
        y = self.pose.y - v * ages * np.sin(half)
        theta = self.pose.theta + turn
        c, s = np.cos(theta), np.sin(theta)
        x += c * base_from_laser.x - s * base_from_laser.y
        y += s * base_from_laser.x + c * base_from_laser.y
        angles = theta + base_from_laser.theta + bearings
        rays = np.array([np.cos(angles), np.sin(angles)]).T
        segments, _ = self.place.laser
        return cast(np.array([x, y]).T, rays, segments, self._cylinders_at(ages))

    def _cylinders(self, time: float) -> Array:
        """Columns and legs (K, 3) in the laser's plane at scenario time `time`."""
        walking = [
            (x, y, LEG_RADIUS)
            for person in self.people
            for x, y in legs(person.at(time), person.height, LASER_HEIGHT)
        ]
        _, columns = self.place.laser
        return np.concatenate([columns, np.array(walking).reshape(-1, 3)])

    def _cylinders_at(self, ages: Array) -> Array:
        """Columns and legs (K, 3, N) as each beam meets them, between two instants."""
        oldest = float(ages.max(initial=0.0))
        now = self._cylinders(self._elapsed)
        if oldest <= 0.0:
            return now
        before = self._cylinders(self._elapsed - oldest)
        moved: Array = now[..., None] + (before - now)[..., None] * (ages / oldest)
        return moved

    def render(self, camera: Camera) -> Pixels:
        """A noisy colour image (H, W, 3) BGR of the world's now."""
        return self.draw(self._shot(camera), self.twist.omega)

    def depth(self, camera: Camera) -> npt.NDArray[np.float32]:
        """Depth (H, W) along the optical axis, m, registered with `render`; nan = nothing."""
        return self._renderer.depth(self._shot(camera))

    def still(self, camera: Camera) -> Pixels:
        """What `render` shows, in even light and without noise (H, W, 3) BGR."""
        return self._renderer.still(self._shot(camera))

    def thermal(self, camera: Camera) -> Pixels:
        """A noisy thermal image (H, W); warm is bright."""
        return self._renderer.thermal(self._shot(camera), self.twist.omega)

    def truth_box(self, camera: Camera) -> tuple[Box, float] | None:
        """The target's box in the image and the share of it not hidden by others; for scoring."""
        return self._renderer.box(self._shot(camera), self._target)

    def _shot(self, camera: Camera) -> Shot:
        return Shot(camera, self.pose, self._elapsed)

    def truth(self) -> Truth:
        """What really is, at the world's now."""
        motions = [walker.at(self._elapsed) for walker in self.walkers]
        seen = self._who_is_seen(motions)
        actors = [
            self._actor(walker, motion, sight)
            for walker, motion, sight in zip(self.walkers, motions, seen, strict=True)
        ]
        target = actors.pop(self._target)
        return Truth(
            self.now,
            self.pose,
            self.twist,
            target,
            tuple(actors),
            self._collisions,
            self._bumped,
            self._min_approached,
            self._min_any,
        )

    def _actor(self, walker: Walker, motion: Motion, in_sight: bool) -> Actor:
        x, y = (~self.pose).apply_point(motion.x, motion.y)
        return Actor(
            walker.name,
            motion.x,
            motion.y,
            motion.heading,
            motion.velocity,
            hypot(x, y),
            atan2(y, x),
            in_sight,
        )
