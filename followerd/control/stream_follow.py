"""Go with the flow toward the person: Tseng and Tang 2009, the robot's own motion.

The robot drives as a drop would on the stream field of a sink and of discs around what stands near
it (`followerd.stream_field`), at the speed of Zhuang's distance keeping. The field is a first order
where discs touch, and in a U it has places where nothing flows: so the sink lies on the person only
while the straight way is free, else on the farthest straight-free point of the shortest way there
over the floor that is known (`ground`). Unseen floor counts as free: it is looked at on the way.

Where the person may go out of sight, and while they are hidden, the sink lies on a view point: the
place from which, and on the way to which, most of where they may walk next is seen (`lookout`).
"""

from dataclasses import dataclass
from math import atan2, cos, dist, hypot, inf, radians, sin

import numpy as np
from pydantic import Field

from followerd.control.clearance import Footprint, time_to_contact
from followerd.control.ground import SOLID, Ground, Mask, Point
from followerd.control.image_centering import ImageCentering, ImageCenteringSettings
from followerd.control.interfaces import Scene, Target, View
from followerd.control.lookout import LookoutSettings, lookout, seen, walks
from followerd.control.surroundings import Surroundings
from followerd.geometry import Array, Pose2, wrap_angle
from followerd.messages import TrackPhase, Twist
from followerd.stream_field import Complex, Floats, lines, velocity


class StreamFollowSettings(ImageCenteringSettings):
    """Zhuang's distance keeping, and the way there."""

    stationary_band_deg: float = Field(2.0, ge=0, description="half band without turning")
    turn_gain_per_s: float = Field(2.0, gt=0, description="turn rate per radian off the flow")
    clearance_m: float = Field(0.36, gt=0, description="from the robot's middle, to pass at all")
    comfort_m: float = Field(0.5, gt=0, description="the same; narrower ways count double")
    disc_m: float = Field(0.36, gt=0, description="radius of the discs that part the flow")
    near_m: float = Field(1.2, gt=0, description="returns beyond it part no flow")
    memory_s: float = Field(6.0, ge=0, description="what is out of view is remembered that long")
    aside_deg: float = Field(
        80.0, gt=0, lt=90, description="off the way, a person in sight is kept"
    )
    reach_m: float = Field(5.0, gt=0, description="farther returns are not planned with")
    replan_s: float = Field(0.1, gt=0, description="between two plans, at least")
    lookout: LookoutSettings = LookoutSettings()
    front_m: float = Field(0.21, gt=0, description="from the wheels' axis to the front")
    rear_m: float = Field(0.30, gt=0, description="from the wheels' axis to the rear")
    half_width_m: float = Field(0.213, gt=0)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """Where the flow goes, as planned with one scan."""

    point: Point | None  # m in `odom`, the sink; None: the person
    left: float = 0.0  # m, from there on
    last: float = 0.0  # rad in `odom`, direction of the way's last piece
    watch: Point | None = None  # m in `odom`, what a view point is there to see


STRAIGHT = Course(None)
CLOSER = 0.2  # m that the robot may come closer before the next plan
JUMP = 0.3  # m; more is no drift: the robot was taken for somewhere else
THERE = 0.1  # m from a view point the robot stays and looks
AHEAD = 1.0  # s that a wish must be free of contact, or it is slowed
LINES, ABREAST = 7, 0.75  # stream lines that are drawn, and half their spread, m
INSIDE = 0.05  # m; a return this near is inside the robot and parts no flow
AGAINST = 0.05  # of the free flow; a weaker one has no direction


class StreamFollow:
    """The follow law `stream_field`."""

    Settings = StreamFollowSettings

    def __init__(self, settings: StreamFollowSettings | None = None) -> None:
        self.settings = s = settings or StreamFollowSettings()
        self._keeping = ImageCentering(s)
        self._body = Footprint(s.front_m, s.rear_m, s.half_width_m)
        self._surroundings = Surroundings(s.reach_m, s.memory_s)
        self._planned_at = -inf  # s
        self._close: Array = np.empty((0, 2))  # m in `odom`, returns about the robot
        self._course = STRAIGHT
        self._in_sight = False  # the person, of the laser, at the last plan
        self._place: Point | None = None  # the last view point
        self._way: Array = np.empty((0, 2))  # the last way
        self._map_from_odom: Pose2 | None = None  # at the last plan
        # base, sink, discs' centres and radii (in `base`) of the last flow
        self._field: tuple[Pose2, complex, Complex, Floats] | None = None

    def wish(self, target: Target, scene: Scene) -> Twist:
        """The motion that follows `target`; no forward speed without a range."""
        s, person = self.settings, None
        if target.range is not None:
            along = target.range * cos(target.bearing), target.range * sin(target.bearing)
            person = scene.base.apply_point(*along)
        if scene.view is not None and scene.view.scan.stamp >= self._planned_at + s.replan_s:
            self._planned_at = scene.view.scan.stamp
            self._settle(scene.view)
            self._surroundings.see(scene.view, scene.claimed, person)
            self._close = self._surroundings.within(s.near_m + CLOSER, scene.base)
            self._course = STRAIGHT if person is None else self._planned(target, person, scene)
        if person is None:
            return self._keeping.wish(target)
        near = self.nearby(scene.base)
        wish = self._keeping.wish(self._led(target, near, scene))
        return self._checked(wish, near)

    def sketch(self) -> Array:
        """See Sketched."""
        goal = self._course.point
        if goal is None:
            return np.empty((0, 2))
        return np.array([goal]) if self._course.watch is not None else self._way

    def lines(self) -> Array:
        """See Sketched."""
        if self._field is None:
            return np.empty((0, 0, 2))
        base, sink, centres, radii = self._field
        aside: Complex = (1j * np.linspace(-ABREAST, ABREAST, LINES)).astype(np.complex128)
        z = lines(aside, np.full(LINES, sink), centres, radii, 0.1, 25)
        points = base.apply(np.column_stack([z.real.ravel(), z.imag.ravel()]))
        return points.reshape(*z.shape, 2)

    def _settle(self, view: View) -> None:
        """What is remembered stays where it is on the map, however `odom` drifts."""
        before, now = self._map_from_odom, view.map_from_odom
        self._map_from_odom = now
        if before is None or now is None:
            return
        shift, here = ~now @ before, (view.base.x, view.base.y)
        if dist(shift.apply_point(*here), here) > JUMP:
            return
        self._surroundings.carry(shift)
        self._way = shift.apply(self._way)
        self._place = None if self._place is None else shift.apply_point(*self._place)

    def _planned(self, target: Target, person: Point, scene: Scene) -> Course:
        """The way to the person, or to where they are, or will be, seen better."""
        s, base = self.settings, scene.base
        here = base.x, base.y
        ground = Ground(self._surroundings.points, here, s.clearance_m, s.comfort_m)
        goal = ground.clamped(person)
        self._in_sight = _is_open(ground, here, goal, SOLID)
        velocity = _turned(target.velocity, base.theta)
        hidden = target.phase is not TrackPhase.CONFIRMED
        spread = min(target.sigma, 1.0) if hidden else 0.0
        spots = walks(ground, goal, velocity, spread, s.lookout.horizon_s)
        self._place = place = (
            lookout(ground, goal, spots, base.theta, self._place, s.lookout)
            if self._is_risky(ground, goal, spots)
            else None
        )
        if place is not None:
            return Course(place, watch=goal)
        # a person beside a wall is free to be reached all the same
        short = max(0.0, 1.0 - s.comfort_m / max(hypot(goal[0] - here[0], goal[1] - here[1]), 0.1))
        stop = here[0] + short * (goal[0] - here[0]), here[1] + short * (goal[1] - here[1])
        if self._in_sight and _is_open(ground, here, stop, s.clearance_m):
            return STRAIGHT
        ground.spread(goal, self._way)
        self._way = ground.way(goal)
        return self._along(ground, self._way)

    def _is_risky(self, ground: Ground, person: Point, spots: Array) -> bool:
        """Whether to follow straight on may lose sight of them, or lead where it is tight."""
        s, (x, y) = self.settings, ground.here
        away = max(hypot(person[0] - x, person[1] - y), s.max_distance_m)
        share = 1.0 - s.max_distance_m / away
        stop = x + share * (person[0] - x), y + share * (person[1] - y)
        is_roomy = bool((ground.room(np.array([stop])) >= s.lookout.roomy_m).all())
        return not (is_roomy and bool(seen(ground, stop, spots).all()))

    def _along(self, ground: Ground, way: Array) -> Course:
        """To the farthest point of the way (N, 2) that is free straight ahead."""
        s = self.settings
        here = np.array(ground.here)
        ahead = np.arange(1, len(way)) if len(way) > 1 else np.zeros(1, np.intp)
        wide = ground.is_open(here, way[ahead], s.comfort_m)
        free = ground.is_open(here, way[ahead], s.clearance_m)
        free &= np.hypot(*(way[ahead] - here).T) < s.near_m
        k = int(ahead[max(_last(wide), _last(free), 0)])
        left = np.hypot(*np.diff(way[k:], axis=0).T).sum()
        dx, dy = (way[-1] - way[max(0, len(way) - 6)]).tolist()
        x, y = way[k].tolist()
        return Course((x, y), float(left), atan2(dy, dx))

    def nearby(self, base: Pose2) -> Array:
        """The returns (N, 2) about a robot at `odom_from_base`, in `base`, m."""
        s = self.settings
        points = (~base).apply(self._close)
        near: Array = points[np.einsum("ij,ij->i", points, points) < s.near_m**2]
        return near

    def _led(self, target: Target, near: Array, scene: Scene) -> Target:
        """The person as the flow leads there: bearing of the flow, length of the way."""
        s, course = self.settings, self._course
        assert target.range is not None
        if course.point is None or target.range < s.safe_distance_m:
            flow = self._flow(target.range, target.bearing, near, scene.base)
            return Target(flow, target.range, _turned(target.velocity, flow - target.bearing))
        x, y = (~scene.base).apply_point(*course.point)
        distance = hypot(x, y)
        if course.watch is not None and distance < THERE:
            return Target(target.bearing, s.max_distance_m)
        flow = self._flow(distance, atan2(y, x), near, scene.base)
        flow = self._in_view(flow, target)
        if course.watch is not None:
            speed = hypot(*target.velocity)
            keep_up = speed * cos(flow), speed * sin(flow)
            return Target(flow, distance + s.max_distance_m, keep_up)
        # the person's speed along the way's last piece lengthens the way
        last = course.last - scene.base.theta
        growth = cos(last) * target.velocity[0] + sin(last) * target.velocity[1]
        return Target(flow, distance + course.left, (growth * cos(flow), growth * sin(flow)))

    def _in_view(self, flow: float, target: Target) -> float:
        """No farther from the person than that the laser keeps them in view."""
        if target.phase is not TrackPhase.CONFIRMED or not self._in_sight:
            return flow
        off = wrap_angle(flow - target.bearing)
        most = radians(self.settings.aside_deg)
        return wrap_angle(target.bearing + min(max(off, -most), most))

    def _flow(self, distance: float, bearing: float, near: Array, base: Pose2) -> float:
        """Bearing of the flow to a sink, rad; the robot is at `base`."""
        s = self.settings
        sink = distance * np.exp(1j * bearing)
        z = near[:, 0] + 1j * near[:, 1]
        size = np.abs(z)
        # what lies behind the robot, or beyond or around the sink, parts no flow
        ahead = (z * np.conj(sink)).real > -0.5 * s.disc_m * distance
        apart = (size > INSIDE) & (size < distance) & (np.abs(z - sink) > 1.1 * s.disc_m)
        z = z[ahead & apart]
        centres = _apart(z, 2.0 * s.disc_m)
        # a robot inside a disc is let along its rim
        radii = np.minimum(s.disc_m, 0.95 * np.abs(centres))
        self._field = base, complex(sink), centres, radii
        flow = velocity(
            np.zeros(1, complex), np.array([sink]), np.array([distance]), centres, radii
        )[0]
        return float(np.angle(flow)) if abs(flow) > AGAINST else bearing

    def _checked(self, wish: Twist, near: Array) -> Twist:
        """The wish, slower toward what it would touch."""
        if wish.v <= 0.0 or not len(near):
            return wish
        free = float(time_to_contact(near, wish, self._body).min())
        share = min(1.0, free / AHEAD)
        if share < 0.2:
            return Twist(0.0, wish.omega)
        return Twist(share * wish.v, share * wish.omega)


def _is_open(ground: Ground, start: Point, end: Point, clearance: float) -> bool:
    return bool(ground.is_open(np.array([start]), np.array([end]), clearance)[0])


def _last(flags: Mask) -> int:
    """Index of the last that is true, -1 if none."""
    return int(np.flatnonzero(flags)[-1]) if flags.any() else -1


def _turned(vector: tuple[float, float], angle: float) -> tuple[float, float]:
    c, s = cos(angle), sin(angle)
    return c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]


def _apart(z: Complex, gap: float) -> Complex:
    """Of points (N,), the nearest to 0, then the nearest that is `gap` from those, and so on."""
    chosen = []
    z = z[np.argsort(np.abs(z), kind="stable")]
    while z.size:
        chosen.append(z[0])
        z = z[np.abs(z - z[0]) > gap]
    return np.array(chosen, complex)
