"""The image tracker works on the newest frame; enrolment honours the frame that was clicked."""

import asyncio
import threading
from dataclasses import replace

import numpy as np
import pytest

from followerd import clock
from followerd.errors import UsageError
from followerd.events import Tracked
from followerd.geometry import Camera, Pose2
from followerd.messages import Box, Image, Odometry, Place, Scan, TrackPhase, TrackState
from followerd.record.journal import Dropped, Entry
from followerd.runtime.vision import Vision
from followerd.trackers.looking import HISTORY, Looking

CAMERA = Camera.from_hfov(64, 48, 0.8)


def frame(number: int) -> Image:
    stamp = number / 15
    return Image(number, stamp, stamp, np.full((48, 64, 3), number, np.uint8), CAMERA)


class Recorder:
    """A tracker that notes what it is given; `gate` makes it slow."""

    needs = frozenset({"image"})
    sees = frozenset({"colour", "depth"})

    def __init__(self) -> None:
        self.calls: list[tuple[str, int]] = []
        self.gate: threading.Event | None = None

    def enrol(
        self, seen: Image | Scan, region: Box | tuple[float, float], ego: Pose2 | None
    ) -> TrackState:
        assert isinstance(seen, Image)
        self.calls.append(("enrol", seen.id))
        return TrackState(seen.stamp, TrackPhase.TENTATIVE, 1.0, seen.id)

    def step(
        self,
        measurement: Image | Scan | Odometry,
        ego: Pose2 | None,
        place: Place | None = None,
    ) -> TrackState | None:
        assert isinstance(measurement, Image)
        if self.gate is not None:
            self.gate.wait(5.0)
        self.calls.append(("step", measurement.id))
        return TrackState(measurement.stamp, TrackPhase.CONFIRMED, 1.0, measurement.id)

    def forget(self) -> None:
        self.calls.append(("forget", -1))


def unknown(stamp: float) -> None:
    """Neither where the robot was nor where the person."""


async def test_while_the_tracker_works_only_the_newest_frame_waits() -> None:
    tracker, results, journal = Recorder(), list[Tracked](), list[Entry]()
    tracker.gate = threading.Event()
    vision = Vision(Looking(tracker, unknown, unknown), results.append, journal.append, work=0.0)
    task = asyncio.create_task(vision.run())
    vision.offer(frame(0))
    await clock.sleep(0.05)
    for number in (1, 2, 3):
        vision.offer(frame(number))
        await clock.sleep(0.0)
    tracker.gate.set()
    while len(results) < 2:
        await clock.sleep(0.005)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert [result.frame_id for result in results] == [0, 3]
    assert vision.dropped == 2
    dropped = [entry.frame_id for entry in journal if isinstance(entry, Dropped)]
    assert dropped == [1, 2]


def virtual_vision(tracker: Recorder) -> tuple[Vision, list[Tracked]]:
    """A vision and the results it delivers."""
    results: list[Tracked] = []
    looking = Looking(tracker, unknown, unknown)
    return Vision(looking, results.append, lambda _: None, work=0.01), results


def test_in_virtual_time_the_result_comes_after_the_modelled_duration() -> None:
    async def main() -> float:
        stamps: list[float] = []
        looking = Looking(Recorder(), unknown, unknown)
        vision = Vision(looking, lambda _: stamps.append(clock.now()), lambda _: None, work=0.01)
        task = asyncio.create_task(vision.run())
        vision.offer(frame(0))
        await clock.sleep(1.0)
        task.cancel()
        return stamps[0]

    assert clock.run_virtual(main()) == pytest.approx(0.01)


def test_enrolling_on_an_older_frame_catches_up_through_the_newer_ones() -> None:
    async def main() -> list[tuple[str, int]]:
        tracker = Recorder()
        vision, results = virtual_vision(tracker)
        task = asyncio.create_task(vision.run())
        for number in range(5):
            vision.offer(frame(number))
            await clock.sleep(1 / 15)
        tracker.calls.clear()
        await vision.enrol((3.0, 4.0), 2)
        task.cancel()
        assert results[-1].frame_id == 4
        return tracker.calls

    assert clock.run_virtual(main()) == [("enrol", 2), ("step", 3), ("step", 4)]


@pytest.mark.parametrize(("frames", "wanted"), [(0, None), (HISTORY + 5, 1), (3, 99)])
def test_enrolling_on_a_frame_that_is_gone_says_so(frames: int, wanted: int | None) -> None:
    async def main() -> None:
        vision, _ = virtual_vision(Recorder())
        task = asyncio.create_task(vision.run())
        for number in range(frames):
            vision.offer(frame(number))
            await clock.sleep(1 / 15)
        try:
            await vision.enrol((3.0, 4.0), wanted)
        finally:
            task.cancel()

    with pytest.raises(UsageError, match=r"frame|image"):
        clock.run_virtual(main())


def test_a_picture_that_repeats_itself_is_no_new_one() -> None:
    """FAILSAFES F3: its stream goes stale as if the camera said nothing."""

    async def main() -> list[int | None]:
        vision, results = virtual_vision(Recorder())
        task = asyncio.create_task(vision.run())
        for number, shown in enumerate((0, 1, 1, 1, 2)):
            vision.offer(replace(frame(number), pixels=frame(shown).pixels))
            await clock.sleep(1 / 15)
        task.cancel()
        return [result.frame_id for result in results]

    assert clock.run_virtual(main()) == [0, 1, 4]
