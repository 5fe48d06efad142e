"""What is recorded can be read, replayed to the bit, and survives what happens to files."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd import app, clock, config
from followerd.__main__ import call
from followerd.bench.closed_loop import simulate
from followerd.cli.recording import recorded
from followerd.config import Config
from followerd.control.transitions import Action
from followerd.errors import UsageError
from followerd.events import Event, Operator, Tick, Tracked
from followerd.geometry import Camera, Pose2
from followerd.hw.camera.calibration import Calibration, Lens
from followerd.messages import (
    Box,
    Fault,
    Image,
    Odometry,
    Place,
    Scan,
    StopReason,
    TrackPhase,
    TrackState,
    Twist,
)
from followerd.record.codec import plain, restored
from followerd.record.journal import Dropped, Enrolled, Entry, Looked, Taken
from followerd.record.reading import LENS, Decided, Heard, Numbered, Recording
from followerd.record.recorder import Recorder
from followerd.record.recovery import recover
from followerd.record.replay import Replay
from followerd.record.scribe import Scribe
from followerd.record.settings import RecordSettings
from followerd.record.still import kept
from followerd.record.tape import Tape
from followerd.record.wire import Teller, told
from followerd.runtime.recording import Recording as Switch
from followerd.runtime.recording import described

CAMERA = Camera(64, 48, 60.0, 60.0, 32.0, 24.0)
any_float = st.floats(allow_nan=False)
scan_ranges = st.lists(st.floats(), min_size=1, max_size=8).map(np.array)


def scan(ranges: np.ndarray, stamp: float = 1.0) -> Scan:
    """A scan of a few beams."""
    return Scan(stamp, stamp, -1.0, 0.5, ranges, 8.0, np.zeros(ranges.size), Pose2(0.1, 0.0, 0.0))


events: st.SearchStrategy[Event] = st.one_of(
    st.builds(scan, scan_ranges, any_float),
    st.builds(
        lambda x, v, volts: Odometry(1.0, 1.1, Pose2(x, 0.0, 0.1), Twist(v, 0.0), battery=volts),
        any_float,
        any_float,
        st.floats(),
    ),
    st.builds(lambda a: Operator(a, "page"), st.sampled_from(Action)),
    st.builds(lambda r: Fault(1.0, "laser", r, "gone"), st.sampled_from(StopReason)),
    st.builds(
        lambda p, c: Tracked(1.0, 1.2, 7, TrackState(1.0, p, c, 7, Box(1.0, 2.0, 3.0, 4.0))),
        st.sampled_from(TrackPhase),
        any_float,
    ),
    st.just(Tick()),
)
entries: st.SearchStrategy[Entry] = st.one_of(
    st.builds(Taken, any_float, events),
    st.builds(lambda n: Looked(n, 3, Pose2(n, 0.0, 0.0), Place(n, 0.1)), any_float),
    st.builds(lambda n: Enrolled(n, 3, Box(1.0, n, 3.0, 4.0)), any_float),
    st.builds(lambda n: Enrolled(n, 3, (n, 4.0)), any_float),
    st.builds(lambda n: Dropped(n, 4), any_float),
)


@given(entries)
def test_whatever_the_daemon_consumes_comes_back_to_the_bit(entry: Entry) -> None:
    text = json.dumps(plain(entry), allow_nan=False)
    again = restored(Taken | Looked | Enrolled | Dropped, json.loads(text))
    assert plain(again) == plain(entry)
    assert type(again) is type(entry)


@given(st.lists(st.lists(entries, max_size=4), max_size=4))
def test_nouns_reach_another_process_batch_by_batch_to_the_bit(batches: list[list[Entry]]) -> None:
    line = BytesIO()
    teller = Teller(line)
    for batch in batches:
        for entry in batch:
            teller.tell(("entry", entry, entry))
        teller.end_batch()
    line.seek(0)
    arrived = list[tuple[str, Entry, Entry]]()
    with pytest.raises(EOFError):
        arrived.extend(told(line))
    for (_, again, same), entry in zip(arrived, chain(*batches), strict=True):
        assert plain(again) == plain(entry)
        assert type(again) is type(entry)
        assert again is same


@pytest.mark.parametrize("value", [{"kind": "Nothing"}, {"kind": "Taken"}, 3, "x", None])
def test_what_is_no_entry_is_refused(value: object) -> None:
    with pytest.raises((ValueError, TypeError, KeyError)):
        restored(Taken | Looked | Enrolled | Dropped, value)


def image(number: int) -> Image:
    """A small picture of its own."""
    rng = np.random.default_rng(number)
    pixels = rng.integers(0, 255, (48, 64, 3), np.uint8)
    depth = np.where(rng.random((48, 64)) < 0.1, np.nan, 2.0).astype(np.float32)
    return Image(number, 0.1 * number, 0.1 * number + 0.03, pixels, CAMERA, depth)


def test_exact_images_come_back_to_the_bit(tmp_path: Path) -> None:
    tape = Tape(tmp_path / "a.mcap", RecordSettings(images="exact"), {}, 0.0)
    for number in range(3):
        tape.image(image(number))
    tape.close()
    found = [record for record in Recording(tmp_path / "a.mcap") if isinstance(record, Image)]
    for number, again in enumerate(found):
        assert plain(again) == plain(image(number))
    assert len(found) == 3


@pytest.mark.parametrize(
    ("images", "sent", "has_jpeg", "has_raw", "has_depth"),
    [
        ("exact", b"own", True, False, True),
        ("exact", None, False, True, True),
        ("jpeg", b"own", True, False, True),
        ("jpeg", None, True, False, True),
        ("none", b"own", False, False, False),
    ],
)
def test_only_what_is_recorded_of_an_image_goes_to_another_process(
    images: Literal["exact", "jpeg", "none"],
    sent: bytes | None,
    has_jpeg: bool,
    has_raw: bool,
    has_depth: bool,
) -> None:
    still = kept(replace(image(1), jpeg=sent), RecordSettings(images=images))
    assert (still.jpeg is not None, still.raw is not None) == (has_jpeg, has_raw)
    assert (still.depth is not None) == has_depth
    assert still.is_own == (still.jpeg == b"own")


@pytest.mark.parametrize("bent", [False, True])
def test_a_cameras_own_jpeg_is_kept_and_shown_as_it_was(bent: bool, tmp_path: Path) -> None:
    lens = Calibration(
        width=64, height=48, fx=60, fy=60, cx=32, cy=24, distortion=(-0.2, 0.05, 0, 0, 0)
    )
    own = bytes(cv2.imencode(".jpg", image(1).pixels)[1])
    sent = cv2.imdecode(np.frombuffer(own, np.uint8), cv2.IMREAD_COLOR)
    assert sent is not None
    pixels = np.asarray(sent, np.uint8)
    if bent:
        pixels = Lens(lens).straight(pixels)
    seen = Image(1, 0.1, 0.13, pixels, CAMERA, jpeg=own)
    about = {LENS: lens.model_dump_json()} if bent else {}
    tape = Tape(tmp_path / "a.mcap", RecordSettings(images="exact"), about, 0.0)
    tape.image(seen)
    tape.image(image(2))  # and raw, where the camera does not say it so
    tape.close()
    found = [record for record in Recording(tmp_path / "a.mcap") if isinstance(record, Image)]
    assert [plain(each) for each in found] == [plain(seen), plain(image(2))]


def test_a_recording_tells_no_secrets() -> None:
    settings = config.load("hpf-sim", {"web.token": "a-long-secret-word", "web.host": "0.0.0.0"})
    assert "secret" not in str(described(settings))


def run(path: Path, duration: float, *, record: RecordSettings, tracker: str = "hpf") -> Config:
    """Record a simulated run in virtual time."""
    chosen = config.load(f"{tracker}-sim").model_copy(update={"record": record})
    with recorded(path, chosen) as watchers:
        simulate(chosen, duration, *watchers)
    return chosen


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of a few seconds, recorded exactly."""
    path = tmp_path_factory.mktemp("recording") / "run.mcap"
    run(path, 5.0, record=RecordSettings(images="exact"))
    return path


def differences(recording: Recording) -> Iterator[str]:
    """What comes out otherwise than recorded, decision by decision."""
    chosen = config.parse(recording.about["config"], "recorded")
    for pair in Replay(*app.thinking(chosen)).run(recording):
        yield pair.difference


def test_a_replay_makes_the_same_decisions_to_the_bit(exact: Path) -> None:
    found = list(differences(Recording(exact)))
    assert len(found) > 250
    assert not any(found)


@pytest.mark.slow
def test_a_replay_notices_a_single_changed_bit(exact: Path) -> None:
    changed = []
    for record in Recording(exact):
        if isinstance(record, Image) and record.id == 30:
            pixels = record.pixels.copy()
            pixels[70:90, 80:100] ^= 1
            record = replace(record, pixels=pixels)
        changed.append(record)
    chosen = config.parse(Recording(exact).about["config"], "recorded")
    pairs = list(Replay(*app.thinking(chosen)).run(changed))
    assert any(pair.difference for pair in pairs)


def test_replay_says_that_it_is_identical(exact: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert call(["replay", str(exact)]) == 0
    said = dict(line.split(": ", 1) for line in capsys.readouterr().out.strip().splitlines())
    assert said["identical"] == said["decisions"]
    assert said["why_not"] == "[]"


@pytest.mark.slow
def test_another_tracker_is_shown_beside_the_recorded_one(exact: Path, tmp_path: Path) -> None:
    out, summary = tmp_path / "both.csv", tmp_path / "s.json"
    command = ["replay", str(exact), "--tracker", "hpf/paper", "--out", str(out)]
    assert call([*command, "--summary", str(summary)]) == 0
    found = json.loads(summary.read_text())
    assert found["identical"] is None
    assert found["why_not"] == ["another config"]
    assert len(out.read_text().splitlines()) == found["tracks"] + 1


@pytest.mark.slow
def test_with_jpeg_replay_says_why_it_need_not_be_identical(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    run(path, 2.5, record=RecordSettings(images="jpeg"))
    summary = tmp_path / "s.json"
    assert call(["replay", str(path), "--summary", str(summary)]) == 0
    assert json.loads(summary.read_text())["why_not"] == ["images were recorded as jpeg"]


@pytest.mark.slow
def test_info_plot_and_export_tell_what_happened(
    exact: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert call(["info", str(exact)]) == 0
    assert "following: " in capsys.readouterr().out
    for name in ("a.png", "a.html"):
        assert call(["plot", str(exact), "--out", str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 10_000


@pytest.mark.slow
def test_a_bag_written_for_ros_comes_back(exact: Path, tmp_path: Path) -> None:
    bag, again = tmp_path / "bag", tmp_path / "again.mcap"
    assert call(["export", str(exact), "--rosbag2", str(bag)]) == 0
    assert call(["import", str(bag), "--out", str(again)]) == 0
    before = [r for r in Recording(exact) if isinstance(r, Image)]
    after = [r for r in Recording(again) if isinstance(r, Image)]
    assert len(after) == len(before)
    assert (after[5].pixels == before[5].pixels).all()
    assert [r.id for r in after] == list(range(len(after)))


@pytest.mark.slow
def test_trackers_run_on_recordings_and_bags(exact: Path, tmp_path: Path) -> None:
    command = ["track", str(exact), "--init", "73.7,10.9,41.5,101.7", "--start", "15"]
    assert call([*command, "--out", str(tmp_path / "a.csv")]) == 0
    assert (tmp_path / "a.csv").read_text().count("tracked") > 50
    command = ["track", str(exact), "--tracker", "legs", "--init", "2.1,0"]
    assert call([*command, "--out", str(tmp_path / "b.csv")]) == 0
    assert (tmp_path / "b.csv").read_text().count("odom") > 150


def journal(path: Path) -> list[int]:
    """Numbers of the entries that can be read."""
    return [record.number for record in Recording(path) if isinstance(record, Numbered)]


@pytest.mark.slow
def test_cut_off_anywhere_a_recording_gives_what_was_whole(exact: Path, tmp_path: Path) -> None:
    whole, content = journal(exact), exact.read_bytes()
    rng, last = np.random.default_rng(5), 0
    for size in sorted(rng.integers(2000, len(content), 6).tolist()):
        cut, mended = tmp_path / f"{size}.mcap", tmp_path / f"{size}-recovered.mcap"
        cut.write_bytes(content[:size])
        found = journal(cut)
        assert found == whole[: len(found)]
        assert len(found) >= last
        last = len(found)
        if found:
            recover(cut, mended)
            assert journal(mended) == found
    assert last > 0.5 * len(whole)


def test_a_damaged_recording_is_read_up_to_the_damage(exact: Path, tmp_path: Path) -> None:
    content = bytearray(exact.read_bytes())
    content[len(content) // 2 :][:1000] = bytes(1000)
    for at in range(len(content) // 2, len(content) // 2 + 1000):
        content[at] ^= 0x5A
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(content)
    recording = Recording(damaged)
    found = [r.number for r in recording if isinstance(r, Numbered)]
    assert found == list(range(1, len(found) + 1))
    assert recording.truncated


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"", "is no recording"), (b"hello", "is no recording"), (None, "no such recording")],
)
def test_what_is_no_recording_is_said_in_one_line(
    content: bytes | None, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    for command in ("info", "replay", "plot"):
        assert call([command, str(path)]) == 2
        assert said in capsys.readouterr().err


@pytest.mark.slow
def test_a_long_recording_goes_on_in_another_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    run(path, 4.0, record=RecordSettings(images="exact", max_file_mb=2.0))
    assert len(Recording(path).parts) > 2
    assert journal(path) == list(range(1, len(journal(path)) + 1))
    assert not any(differences(Recording(path)))


def test_recordings_are_never_overwritten(exact: Path) -> None:
    with pytest.raises(UsageError, match="new file"), recorded(exact, config.load("hpf-sim")):
        pass
    with pytest.raises(UsageError, match="exists"):
        Tape(exact, RecordSettings(), {}, 0.0)


@pytest.mark.slow
def test_a_disk_that_fills_ends_the_recording_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    chosen = config.load("hpf-sim").model_copy(update={"record": RecordSettings(min_free_mb=1e9)})
    with recorded(path, chosen) as watchers:
        figures = simulate(chosen, 6.0, *watchers)
    assert figures["mode_s"]["following"] > 2.0
    assert figures["scans"] > 150
    assert 0 < len(journal(path)) < 20  # whole, and short


class SlowTape(Tape):
    """A disk that hangs until it is let go."""

    gate = threading.Event()

    def image(self, image: Image) -> None:
        self.gate.wait(10.0)
        super().image(image)


def test_what_a_slow_disk_cannot_take_is_dropped_images_first(tmp_path: Path) -> None:
    settings = RecordSettings(queue=100, queued_images=5)
    tape = SlowTape(tmp_path / "a.mcap", settings, {}, 0.0)
    recorder = Recorder(tape)
    for number in range(20):
        recorder.measured(image(number))
        recorder.consumed(Dropped(0.1 * number, number))
    assert recorder.dropped_images >= 14
    assert recorder.dropped == 0
    for number in range(20, 200):
        recorder.consumed(Dropped(0.1 * number, number))
    assert recorder.dropped > 50
    tape.gate.set()
    recorder.consumed(Dropped(99.0, 99))
    recorder.close()
    found = journal(tmp_path / "a.mcap")
    assert found == sorted(found)
    assert len(found) + recorder.dropped == 201


def test_a_recording_written_by_another_process_is_the_same(tmp_path: Path) -> None:
    settings = RecordSettings(images="exact")
    scribe = Scribe(tmp_path / "a.mcap", settings, {"config": "x"}, 0.0)
    scribe.wait()
    recorder, tape = Recorder(scribe), Tape(tmp_path / "b.mcap", settings, {"config": "x"}, 0.0)
    for number in range(1, 9):
        recorder.measured(image(number))
        tape.image(image(number))
        recorder.consumed(Taken(0.1 * number, scan(np.ones(5), 0.1 * number)))
        tape.entry(Taken(0.1 * number, scan(np.ones(5), 0.1 * number)), number)
    recorder.close()
    tape.close()
    written, same = (Recording(tmp_path / name) for name in ("a.mcap", "b.mcap"))
    assert written.about == same.about
    assert list(map(described_in_full, written)) == list(map(described_in_full, same))


def described_in_full(record: object) -> object:
    """A record of a recording, to compare."""
    return plain(record) if isinstance(record, Image) else repr(record)


@pytest.mark.slow
@pytest.mark.parametrize("end", ["full", "killed"])
def test_a_recording_that_another_process_cannot_go_on_with_ends_alone(
    end: str, tmp_path: Path
) -> None:
    settings = RecordSettings(min_free_mb=1e9 if end == "full" else 0.0)
    scribe = Scribe(tmp_path / "a.mcap", settings, {}, 0.0)
    scribe.wait()
    recorder = Recorder(scribe)
    if end == "killed":
        scribes = [child for child in children(os.getpid()) if b".scribe" in command_of(child)]
        os.kill(scribes[0], signal.SIGKILL)
    for number in range(500):
        recorder.consumed(Dropped(0.1 * number, number))
        if recorder.stopped:
            break
        time.sleep(0.02)
    recorder.close()
    assert ("MB left" if end == "full" else "has ended") in recorder.stopped


@pytest.mark.slow
def test_a_place_where_nothing_can_be_written_is_told_at_once(tmp_path: Path) -> None:
    scribe = Scribe(tmp_path / "no" / "a.mcap", RecordSettings(), {}, 0.0)
    with pytest.raises(UsageError, match="cannot be written"):
        scribe.wait()


@pytest.mark.slow
def test_a_gap_is_named_by_replay(exact: Path) -> None:
    records = [
        r for r in Recording(exact) if not (isinstance(r, Numbered) and 100 < r.number < 120)
    ]
    chosen = config.parse(Recording(exact).about["config"], "recorded")
    replay = Replay(*app.thinking(chosen))
    assert sum(1 for _ in replay.run(records)) > 250
    assert replay.gaps == 1


def test_decisions_are_recorded_with_their_reasons(exact: Path) -> None:
    decisions = [r.plain for r in Recording(exact) if isinstance(r, Decided)]
    assert decisions[0]["mode"] == "disarmed"
    assert decisions[0]["reasons"]
    assert decisions[-1]["mode"] == "following"


@pytest.mark.slow
def test_on_request_the_devices_bytes_are_recorded_both_ways(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    run(path, 3.0, record=RecordSettings(images="none", raw_bytes=True))
    heard: dict[str, bytes] = {}
    for record in Recording(path):
        if isinstance(record, Heard):
            heard[record.device] = heard.get(record.device, b"") + record.data
    assert heard["base-sent"].startswith(b"\xfa\xfb")
    assert heard["laser"].count(b"\x02\x80") > 50
    assert heard.keys() == {"base", "base-sent", "laser", "laser-sent"}


def children(parent: int) -> list[int]:
    """Processes that a process has started."""
    tasks = Path(f"/proc/{parent}/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def command_of(process: int) -> bytes:
    """What it was started by."""
    return Path(f"/proc/{process}/cmdline").read_bytes()


def lives(process: int) -> bool:
    """Whether a process has not ended."""
    with suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


@pytest.mark.slow
@pytest.mark.realtime
def test_killed_in_mid_recording_at_most_a_second_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    command = [sys.executable, "-m", "followerd", "demo", "--headless", "--duration", "60"]
    command += ["--record", str(path)]
    with subprocess.Popen(command, stdout=-3, stderr=-3) as process:
        while not path.exists():
            time.sleep(0.05)
        time.sleep(6.0)
        others = children(process.pid)
        killed = time.time()
        process.kill()
    assert others
    while any(lives(other) for other in others):  # the simulation and the last resort end with it
        time.sleep(0.05)
    stamps = [record.stamp for record in Recording(path) if isinstance(record, Decided)]
    last = stamps[-1] + time.time() - time.monotonic()
    assert killed - last < 1.0
    assert path.stat().st_size > 1e6


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["legs", "stream_field"])
def test_a_tracker_of_scans_is_replayed_to_the_bit(tracker: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    run(path, 5.0, record=RecordSettings(images="none"), tracker=tracker)
    found = list(differences(Recording(path)))
    assert len(found) > 250
    assert not any(found)


async def under_way(path: Path) -> None:
    """Switch recording on while the daemon runs, as the page does."""
    chosen = config.load("hpf-sim").model_copy(update={"record": RecordSettings(images="exact")})
    world = app.rig(chosen)
    daemon = app.build(chosen, app.in_memory(world))
    parts = clock.together(world.run(), daemon.run())

    async def record() -> None:
        await clock.sleep(1.0)
        recording = Switch(daemon, chosen)
        recording.start(path)
        await clock.sleep(0.5)
        recorder = recording.stop()
        assert recorder is not None
        recorder.close()
        await clock.forever()

    await clock.within(2.0, clock.together(parts, record()))


def test_a_recording_begun_under_way_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.mcap"
    clock.run_virtual(under_way(path))
    assert call(["replay", str(path)]) == 0
    assert "recording began while the daemon ran" in capsys.readouterr().out


def test_a_daemon_that_starts_anew_is_recorded_into_another_file(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    chosen = config.load("hpf-sim").model_copy(update={"record": RecordSettings(images="none")})
    with recorded(path, chosen) as watchers:
        for _ in range(2):
            simulate(chosen, 0.5, *watchers)
    assert journal(path) == list(range(1, len(journal(path)) + 1))
    assert journal(tmp_path / "a.2.mcap") == journal(path)
