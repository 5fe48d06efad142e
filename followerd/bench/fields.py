"""A picture of the robot from above: its footprint, what it keeps free, what its sensors see."""

from collections.abc import Sequence
from math import degrees, hypot

from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle, Wedge

from followerd.control.clearance import stopping_distance
from followerd.control.limits import GuardSettings
from followerd.geometry import Camera
from followerd.hw.lms200.settings import Lms200Settings

SHARES = (1.0, 0.6, 0.3)  # of the highest speed
REACH = 4.0  # m, to which sensors are drawn
COLOURS = ("#f4a582", "#fddbc7", "#f7f1ec")


def draw(axes: Axes, guard: GuardSettings, laser: Lms200Settings, camera: Camera) -> None:
    """Forward is up."""
    _sensors(axes, laser, camera)
    fields(axes, guard)
    width = 2.0 * guard.half_width_m
    body = (-guard.half_width_m, -guard.rear_m), width, guard.front_m + guard.rear_m
    axes.add_patch(Rectangle(*body, facecolor="#404040", label="footprint"))
    grown = guard.turn_margin_m
    corner = max(guard.front_m, guard.rear_m) + grown, guard.half_width_m + grown
    axes.add_patch(
        Circle((0, 0), hypot(*corner), fill=False, color="#404040", ls=":", label="swept in turns")
    )
    axes.add_patch(
        Circle(
            (0, 0),
            guard.min_target_m,
            fill=False,
            color="#b2182b",
            ls="--",
            label=f"the person: no speed ahead within {guard.min_target_m:g} m",
        )
    )
    axes.plot(0, 0, "w+")
    axes.set(xlim=(2.6, -2.6), ylim=(-1.6, REACH), xlabel="left, m", ylabel="ahead, m")
    axes.set_aspect("equal")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8, ncols=2)


def fields(axes: Axes, guard: GuardSettings) -> None:
    """What must be free at some speeds: braking and reaction before the margin, and aside."""
    half = guard.half_width_m + guard.side_margin_m
    for share, colour in zip(SHARES, COLOURS, strict=True):
        speed = share * guard.speed_cap
        ahead = field_length(guard, speed) + guard.margin_m
        label = f"free ahead at {speed:.2f} m/s: {ahead:.2f} m"
        corner = (-half, guard.front_m)
        axes.add_patch(Rectangle(corner, 2 * half, ahead, fc=colour, ec="#8c510a", label=label))
    back = field_length(guard, guard.max_reverse_mps) + guard.rear_margin_m
    corner = (-half, -guard.rear_m - back)
    label = f"free behind at {guard.max_reverse_mps:.2f} m/s: {back:.2f} m (sonar)"
    axes.add_patch(Rectangle(corner, 2 * half, back, fc="#d1e5f0", ec="#2166ac", label=label))


def field_length(guard: GuardSettings, speed: float) -> float:
    """Way to standstill from `speed`, m."""
    return stopping_distance(speed, guard.reaction_s, guard.deceleration_mps2)


def _sensors(axes: Axes, laser: Lms200Settings, camera: Camera) -> None:
    mount = laser.mount.base_from_laser
    half = 0.5 * laser.field_deg
    side = -1 if laser.mount.upside_down else 1
    right, left = sorted(side * degree for degree in laser.sector_deg or (-half, half))
    name = f"laser, {left - right:g} degrees"
    _wedge(axes, (mount.x, mount.y), degrees(mount.theta), (right, left), "#4393c3", name)
    ends = degrees(camera.bearing(0)), degrees(camera.bearing(camera.width - 1))
    yaw = degrees(camera.yaw)
    sides = sorted((end - yaw + 180.0) % 360.0 - 180.0 for end in ends)
    name = f"camera, {sides[1] - sides[0]:.0f} degrees"
    _wedge(axes, (camera.x, camera.y), yaw, sides, "#1b7837", name)


def _wedge(
    axes: Axes,
    place: tuple[float, float],
    middle: float,
    sides: Sequence[float],
    colour: str,
    name: str,
) -> None:
    """A field of view; degrees, left positive, on an axis that grows to the left."""
    first, last = (90.0 - (middle + side) for side in (sides[1], sides[0]))  # ahead is up
    x, y = place
    axes.add_patch(
        Wedge((y, x), REACH, first, last, color=colour, alpha=0.15, label=name, zorder=0)
    )
