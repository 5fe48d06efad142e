"""Pictures drawn in another process: the same to the bit, and an end that is noticed."""

import os
from contextlib import nullcontext
from multiprocessing import active_children
from signal import SIGTERM

import numpy as np
import pytest

from followerd import app, clock
from followerd.bench.closed_loop import simulate, staged
from followerd.config import load
from followerd.errors import Stopped
from followerd.hw.camera.protocol import Frame
from followerd.messages import Decision
from followerd.runtime.daemon import Daemon
from followerd.sim.darkroom import darkroom
from followerd.sim.faults import Fault
from followerd.sim.rig import Rig

# newer Pythons say so when an earlier test has left a thread; the drawing process needs none
pytestmark = pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")


def rig(*faults: str) -> Rig:
    """A rig of the shipped simulation."""
    return app.rig(load("hpf-sim"), [Fault.parse(fault) for fault in faults])


def frames(rig: Rig, seconds: float) -> list[Frame]:
    """What a host gets of the camera."""
    got: list[Frame] = []

    async def main() -> None:
        camera = await rig.camera.link.open("camera")
        while True:
            got.append(await camera.read())

    async def both() -> None:
        await clock.within(seconds, clock.together(rig.run(), main()))

    clock.run_virtual(both())
    return got


@pytest.mark.parametrize(
    "faults",
    [
        (),
        ("camera:split@0.2s+0.3s", "camera:flip@0.6s+0.3s"),
        ("camera:delay@0.1s+0.3s", "camera:drop@0.5s+0.2s", "camera:duplicate@0.7s+0.3s"),
        ("camera:stuck@0.2s+0.2s", "camera:wrong@0.5s+0.2s", "camera:garbage@0.8s+0.2s"),
    ],
)
def test_pictures_are_the_same_wherever_they_are_drawn(faults: tuple[str, ...]) -> None:
    runs = []
    for place in (nullcontext, darkroom):
        here = rig(*faults)
        with place(here):
            runs.append(frames(here, 1.2))
    assert len(runs[0]) > 10
    for one, other in zip(*runs, strict=True):
        assert one.id == other.id
        assert one.stamp == other.stamp
        assert np.array_equal(one.pixels, other.pixels)


def test_the_process_ends_with_its_block() -> None:
    before = set(active_children())
    with darkroom(rig()):
        assert len(set(active_children()) - before) == 1
    assert set(active_children()) == before


def test_a_run_without_its_darkroom_stops() -> None:
    here = rig()
    before = set(active_children())
    with darkroom(here):
        (drawer,) = set(active_children()) - before
        assert drawer.pid is not None
        os.kill(drawer.pid, SIGTERM)
        drawer.join()
        with pytest.raises(Stopped, match="the process that draws the pictures has ended"):
            frames(here, 1.0)


@pytest.mark.slow
def test_pictures_completed_late_are_complete_when_the_tracker_looks() -> None:
    summaries = []
    for place, develops in ((nullcontext, True), (darkroom, False)):
        settings = staged(load("hpf-sim"))
        here = app.rig(settings)
        with place(here):
            here.camera.develops = develops
            figures = simulate(settings, 2.0, world=here)
        summaries.append({**figures, "wall_s": None, "rss_mb": None})
    assert summaries[0]["frames"] > 10
    assert summaries[0] == summaries[1]


def test_who_asks_for_the_newest_picture_gets_it_complete() -> None:
    settings = staged(load("hpf-sim"))
    here = app.rig(settings)
    blank: list[bool] = []

    def look(daemon: Daemon) -> None:
        def at_a_decision(_: Decision) -> None:
            image = daemon.vision.newest
            if image is not None:
                blank.append(not image.pixels.any())

        daemon.decision_watchers.append(at_a_decision)

    with darkroom(here):
        here.camera.develops = False
        simulate(settings, 1.0, look, world=here)
    assert len(blank) > 10
    assert not any(blank)
