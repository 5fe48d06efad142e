"""A tracker of scans in the daemon: enrolled by a point or a click, blind to the camera."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from math import hypot
from typing import Any

import numpy as np
import pytest

from followerd import app, clock
from followerd.bench.closed_loop import simulate
from followerd.config import load
from followerd.errors import UsageError
from followerd.events import Tracked
from followerd.geometry import Camera, Pose2
from followerd.messages import Box, Image, Mode, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.perception.body_outline import body_box
from followerd.runtime.control_socket import answer
from followerd.runtime.daemon import Daemon
from followerd.runtime.scanning import Scanning
from followerd.sim.rig import Rig
from followerd.trackers.sweeping import Sweeping, person_between
from tests.laser_scenes import legs, scan_of

CAMERA = Camera.from_hfov(192, 144, 0.84)


class Notes:
    """A tracker of scans that notes what it is given."""

    needs = frozenset({"scan"})
    sees: frozenset[str] = frozenset()

    def __init__(self) -> None:
        self.enrolled: list[tuple[float, tuple[float, float]]] = []
        self.stepped: list[float] = []

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        assert isinstance(seen, Scan)
        assert not isinstance(region, Box)
        self.enrolled.append((seen.stamp, region))
        return TrackState(seen.stamp, TrackPhase.TENTATIVE, 0.5)

    def step(
        self, measurement: Image | Scan | Odometry, ego: Pose2 | None, place: Place | None = None
    ) -> TrackState | None:
        self.stepped.append(measurement.stamp)
        if not self.enrolled:
            return None
        return TrackState(measurement.stamp, TrackPhase.CONFIRMED, 1.0)

    def forget(self) -> None:
        self.enrolled.clear()


def scanning(count: int = 20) -> tuple[Scanning, Notes, list[Tracked]]:
    """After `count` scans, ten a second, of a person at (2, 0.4) and another at (3, -0.6)."""
    tracker, results = Notes(), list[Tracked]()
    work = Scanning(Sweeping(tracker, lambda _: Pose2()), results.append, lambda _: None)
    circles = np.vstack([legs((2.0, 0.4), 0.0), legs((3.0, -0.6), 0.0)])
    for k in range(count):
        work.take(scan_of(circles, 0.1 * k), None)
    return work, tracker, results


async def test_a_point_is_enrolled_in_the_newest_scan() -> None:
    work, tracker, results = scanning()
    assert results == []  # nobody is enrolled: there is nothing to tell
    state = work.enrol((1.9, 0.3), None)
    ((stamp, point),) = tracker.enrolled
    assert stamp == pytest.approx(1.9)
    assert point == (1.9, 0.3)
    assert state.phase is TrackPhase.TENTATIVE
    assert [(result.frame_id, result.track) for result in results] == [(None, state)]


@pytest.mark.parametrize(
    ("way", "person"), [("point", (2.0, 0.4)), ("box", (2.0, 0.4)), ("point", (3.0, -0.6))]
)
async def test_a_click_is_the_person_whose_legs_are_in_its_bearing(
    way: str, person: tuple[float, float]
) -> None:
    work, tracker, results = scanning()
    image = Image(7, 1.23, 1.25, np.zeros((144, 192, 3), np.uint8), CAMERA)
    box = body_box(CAMERA, *person)
    work.enrol(box if way == "box" else box.centre, image)
    (stamp, point), *_ = tracker.enrolled
    assert stamp == pytest.approx(1.2)  # the scan of that moment
    assert hypot(point[0] - person[0], point[1] - person[1]) < 0.1
    assert tracker.stepped[-7:] == pytest.approx([1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9])
    assert results[-1].stamp == pytest.approx(1.9)


async def test_a_click_beside_everybody_is_refused() -> None:
    work, _, _ = scanning()
    image = Image(7, 1.23, 1.25, np.zeros((144, 192, 3), np.uint8), CAMERA)
    with pytest.raises(UsageError, match="no legs there"):
        work.enrol((5.0, 70.0), image)
    with pytest.raises(UsageError, match="has not given one"):
        work.enrol(Box(0, 0, 10, 10), None)
    nothing = Scanning(Sweeping(Notes(), lambda _: None), lambda _: None, lambda _: None)
    with pytest.raises(UsageError, match="no scan yet"):
        nothing.enrol((1.0, 0.0), None)


def test_of_two_people_in_view_the_nearer_is_meant() -> None:
    circles = np.vstack([legs((2.0, 0.1), 0.0), legs((3.0, -0.1), 0.0)])
    point = person_between(scan_of(circles), -0.4, 0.4)
    assert point == pytest.approx((2.0, 0.1), abs=0.05)
    assert person_between(scan_of(circles), 0.5, 0.9) is None


@pytest.mark.slow
def test_by_legs_the_robot_follows_and_does_not_stop_for_the_camera() -> None:
    figures = simulate(load("legs-sim", {"seed": 4, "sim.faults": ["camera:off@2s+60s"]}), 6.5)
    assert figures["follow"]["tracking_rate"] > 0.97
    assert figures["mode_s"]["following"] > 3.0
    assert figures["stops"] == []


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["corridor", "turns"])
def test_by_legs_a_person_is_followed_for_half_a_minute(scenario: str) -> None:
    figures = simulate(load("legs-sim", {"seed": 31, "sim.scenario": scenario}), 25.0)
    follow = figures["follow"]
    assert follow["tracking_rate"] > 0.97
    assert (follow["collision_count"], follow["wrong_follow_m"]) == (0, 0.0)


@pytest.mark.slow
def test_on_a_map_the_person_is_followed_and_the_robot_knows_where_it_is() -> None:
    config = load("stream_field-sim", {"seed": 31, "sim.scenario": "office"})
    figures = simulate(config, 16.0)
    assert figures["tracker"] == "stream_field/default"
    assert figures["follow"]["tracking_rate"] > 0.97
    assert figures["follow"]["collision_count"] == 0
    where = figures["localization"]
    assert where["known_rate"] > 0.97
    assert where["position_error_mean_m"] < 0.035
    assert where["heading_error_mean_deg"] < 1.0


class Story:
    """A daemon on its twins, and an operator at its control socket."""

    def __init__(self, daemon: Daemon, rig: Rig) -> None:
        self.daemon = daemon
        self.rig = rig

    async def ask(self, do: str, **more: object) -> dict[str, Any]:
        return await answer(self.daemon, json.dumps({"do": do, **more}).encode())


def tell(config: str, script: Callable[[Story], Awaitable[None]]) -> None:
    async def main() -> None:
        settings = load(config, {"operator": "manual", "seed": 3})
        rig = app.rig(settings)
        daemon = app.build(settings, app.in_memory(rig))
        goes_on = asyncio.create_task(clock.together(rig.run(), daemon.run()))
        try:
            await script(Story(daemon, rig))
        finally:
            goes_on.cancel()

    clock.run_virtual(main())


@pytest.mark.slow
def test_an_operator_enrols_by_metres_or_in_the_picture_and_sees_the_pose() -> None:
    async def script(story: Story) -> None:
        early = await story.ask("enrol", region=[1.5, 0.0])
        assert "no scan yet" in early["error"]
        await clock.sleep(3.0)
        person = story.rig.world.truth().target
        base = ~story.rig.world.pose
        x, y = base.apply_point(person.x, person.y)
        in_metres = await story.ask("enrol", region=[x, y])
        assert in_metres["ok"]
        assert in_metres["position_m"] == pytest.approx([x, y], abs=0.2)
        image = story.daemon.vision.newest
        assert image is not None
        box = body_box(image.camera, x, y)
        clicked = await story.ask("enrol", region=list(box.centre), frame=image.id)
        assert clicked["position_m"] == pytest.approx([x, y], abs=0.2)
        boxed = await story.ask("enrol", region=[box.x, box.y, box.w, box.h])
        assert boxed["position_m"] == pytest.approx([x, y], abs=0.2)
        assert (await story.ask("confirm"))["ok"]
        assert (await story.ask("arm"))["ok"]
        await clock.sleep(2.0)
        status = await story.ask("status")
        assert status["mode"] == Mode.FOLLOWING.value
        robot = story.rig.world.pose
        assert status["pose"]["x_m"] == pytest.approx(robot.x, abs=0.1)
        assert status["pose"]["y_m"] == pytest.approx(robot.y, abs=0.1)

    tell("stream_field-sim", script)
