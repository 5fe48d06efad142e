"""Shipped scenarios are sound with every seed; wrong ones are refused with place and remedy."""

from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from followerd.errors import ConfigError, UsageError
from followerd.geometry import Array, Pose2
from followerd.sim.people import Pedestrian
from followerd.sim.raycast import distance_to_segments
from followerd.sim.scenarios import Scenario, draw, known, load
from followerd.sim.wardrobe import dress
from followerd.sim.world import World

NAMES = (
    "boards", "corridor", "laboratory-fixate", "office", "pillars", "static-ball", "turns",
)  # fmt: skip
STEP = 0.1  # s
BODY = 0.2  # m, radius of a person
FEW, MANY = range(2), range(2, 25)


def paths(world: World) -> dict[str, Array]:
    """Where everybody is (T, 2), every STEP of the scenario."""
    times = np.arange(0.0, world.scenario.duration_s, STEP).tolist()
    return {w.name: np.array([w.at(t)[:2] for t in times]) for w in world.walkers}


shipped = cache(load)


def build(name: str, seed: int) -> World:
    return World(shipped(name), np.random.default_rng(seed))


def target_of(world: World) -> str:
    return next(w.name for w in world.walkers if w.mover.target)


def follow(start: tuple[float, float], target: Array, gap: float) -> Array:
    """An ideal follower (T, 2): on the target's trail, `gap` m of trail behind it."""
    lead_in = np.linspace(start, target[0], 50)
    trail = np.concatenate([lead_in, target])
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(trail, axis=0).T))])
    behind = np.maximum(0.0, length[len(lead_in) :] - gap)
    return np.column_stack([np.interp(behind, length, trail[:, i]) for i in (0, 1)])


def nearest(a: Array, b: Array) -> float:
    return float(np.hypot(*(a - b).T).min())


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", FEW)
def test_nobody_walks_through_walls_others_or_the_robot(name: str, seed: int) -> None:
    world = build(name, seed)
    _check_clearances(world)
    _check_room_for_the_robot(world)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", MANY)
def test_nobody_does_so_with_many_seeds(name: str, seed: int) -> None:
    world = build(name, seed)
    _check_clearances(world)
    _check_room_for_the_robot(world)


def _check_clearances(world: World) -> None:
    segments, circles = world.place.everything
    tracks = paths(world)
    for walker in world.walkers:
        radius = BODY if isinstance(walker, Pedestrian) else 0.12
        for x, y in tracks[walker.name][::3].tolist():
            assert distance_to_segments(x, y, segments).min() > radius
            assert all(np.hypot(x - cx, y - cy) - r > radius for cx, cy, r in circles.tolist())
    for a, b in combinations(tracks.values(), 2):
        assert nearest(a, b) > 2 * BODY


def _check_room_for_the_robot(world: World) -> None:
    """The target comes near neither a parked robot nor one that follows ideally."""
    tracks = paths(world)
    target = tracks.pop(target_of(world))
    start = world.pose.x, world.pose.y
    parked = np.broadcast_to(start, target.shape)
    assert nearest(target, parked) > 0.6
    if world.scenario.task == "follow":
        robot = follow(start, target, 1.5)
        assert nearest(target, robot) > 0.6
        assert all(nearest(other, robot) > 0.45 for other in tracks.values())


@pytest.mark.parametrize("name", NAMES)
def test_the_target_stands_before_the_robot_long_enough_to_be_enrolled(name: str) -> None:
    for seed in FEW:
        world = build(name, seed)
        world.advance(0.0)
        first = world.truth().target
        assert 1.8 < first.distance < 2.7
        assert abs(first.bearing) < 0.35
        assert first.in_sight
        world.advance(2.0 if name == "static-ball" else 4.0)
        assert (world.truth().target.x, world.truth().target.y) == (first.x, first.y)


@pytest.mark.parametrize("name", NAMES)
def test_a_parked_robot_sits_through_the_whole_scenario(name: str) -> None:
    world = build(name, 1)
    bearings = np.radians(np.arange(-90.0, 91.0))
    while world.elapsed < world.scenario.duration_s:
        world.advance(world.now + 0.5)
        ranges = world.ranges(Pose2(), bearings, np.zeros(bearings.size))
        assert np.isfinite(ranges).all()  # rooms are closed
    truth = world.truth()
    assert (truth.collisions, truth.bumped) == (0, 0)
    assert truth.twist.v == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_seeds_differ_in_ways_and_times(name: str) -> None:
    tracks = [paths(w)[target_of(w)] for w in (build(name, seed) for seed in range(4))]
    for a, b in combinations(tracks, 2):
        assert np.hypot(*(a - b).T).max() > 0.3


def test_seeds_differ_in_clothes() -> None:
    rngs = (np.random.default_rng(seed) for seed in range(20))
    worn = {dress(shipped("office").people, rng)[0].outfit.upper.colour for rng in rngs}
    assert len(worn) >= 4


def test_distractors_wear_nearly_the_targets_colours() -> None:
    for seed in range(8):
        target, other = dress(shipped("office").people, np.random.default_rng(seed))[:2]
        ours, theirs = target.outfit.upper, other.outfit.upper
        assert ours.pattern == theirs.pattern
        assert ours.colour != theirs.colour


@pytest.mark.parametrize("seed", FEW)
def test_in_the_office_people_cut_in_between_robot_and_target(seed: int) -> None:
    world = build("office", seed)
    tracks = paths(world)
    target = tracks[target_of(world)]
    robot = follow((world.pose.x, world.pose.y), target, 1.5)
    for name in ("crosses in the south", "crosses in the north"):
        middle = 0.5 * (target + robot)
        assert nearest(tracks[name], middle) < 0.35


def test_the_corridor_target_stops_on_the_way() -> None:
    track = paths(build("corridor", 2))["walker"]
    speed = np.hypot(*np.diff(track, axis=0).T) / STEP
    walking = speed > 0.05
    assert 0.25 < speed[walking].mean() < 0.85
    assert np.count_nonzero(np.diff(walking.astype(int)) == 1) >= 3


def test_a_span_is_drawn_between_its_ends() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw((2.0, 3.0), rng) for _ in range(100)]
    assert min(drawn) >= 2.0
    assert max(drawn) <= 3.0
    assert np.std(drawn) > 0.2
    assert draw(1.5, rng) == 1.5


def test_an_unknown_name_lists_the_known() -> None:
    with pytest.raises(UsageError) as caught:
        load("coridor")
    assert all(name in str(caught.value) for name in NAMES)
    assert set(NAMES) <= set(known())


GOOD = """\
name: mine
people:
  - name: me
    target: true
    path: [{x_m: 2, y_m: 0}]
    outfits: [{upper: {colour: "#102030"}, lower: {colour: "#405060"}}]
"""


def test_a_scenario_may_be_any_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(GOOD)
    assert load(path).name == "mine"
    assert load(str(path)).people[0].target


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("x_m: 2", "x_cm: 200", ":5:12:", "unknown key"),
        ('"#102030"', "red", ":6:", "match pattern"),
        ("x_m: 2", "x_m: [3, 2]", ":5:", "smaller"),
        ("name: mine", "name: mine\nduration_s: -1", ":2:", "greater than 0"),
        ("    target: true\n", "", ":1:1:", "exactly one"),
        ("name: mine", "name: [mine", ":", ""),
        (
            '    outfits: [{upper: {colour: "#102030"}, lower: {colour: "#405060"}}]\n',
            "",
            ":3:",
            "outfits",
        ),
        ("    target: true\n", "    target: true\n    crosses_m: 1\n", ":1:1:", "crosses_m"),
        (
            "name: mine",
            "name: mine\nboxes:\n"
            "  - {x_m: 1, y_m: 1, length_m: 1, width_m: 1, height_m: 1, bottom_m: 2}",
            ":3:",
            "below",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, place: str, words: str
) -> None:
    path = tmp_path / "mine.yaml"
    assert old in GOOD
    path.write_text(GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load(path)
    assert f"mine.yaml{place}" in str(caught.value)
    assert words in str(caught.value)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nowhere"):
        load(tmp_path / "nowhere.yaml")


def test_a_crosser_whose_path_meets_nobody_is_refused() -> None:
    document = shipped("office").model_dump()
    crosser = next(p for p in document["people"] if p["crosses_m"] is not None)
    crosser["path"] = [{"x_m": 9, "y_m": 3}, {"x_m": 9, "y_m": 3.5}]
    with pytest.raises(ConfigError, match="crosses_m"):
        World(Scenario.model_validate(document), np.random.default_rng(0))
