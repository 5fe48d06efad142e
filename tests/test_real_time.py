"""Real processes, ptys and clocks: the daemon against `followerd sim`, as against hardware."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from math import hypot
from pathlib import Path

import pytest

from followerd.sim import truth_log
from followerd.sim.truth import Truth

pytestmark = [pytest.mark.slow, pytest.mark.realtime]

FOLLOWERD = [sys.executable, "-m", "followerd"]
CONFIG = """\
base: {kind: p2os, link: sim}
laser: {kind: lms200, link: sim, baud: 500000, resolution_deg: 0.5}
camera: {kind: camera, link: sim, width: 192, height: 144, rate_hz: 15}
tracker: {kind: hpf}
controller: {kind: image_centering}
"""


class Lab:
    """A simulated robot in a process of its own, and daemons started against it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.truth = folder / "truth.jsonl"
        self.links = folder / "links"
        self.processes: list[subprocess.Popen[bytes]] = []
        self.sim = self.start(
            "sim", "corridor", "--links", str(self.links), "--truth", str(self.truth)
        )
        self.until(lambda: self.truth.exists() and bool(truth_log.read(self.truth)))

    def start(self, *arguments: str) -> "subprocess.Popen[bytes]":
        """A followerd process."""
        process = subprocess.Popen(
            [*FOLLOWERD, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        self.processes.append(process)
        return process

    def daemon(self, operator: str, *more: str, base: str = "sim") -> "subprocess.Popen[bytes]":
        """A daemon whose operator is `auto` or `manual`; `base` is the link of its base."""
        config = self.folder / f"{operator}.yaml"
        devices = CONFIG.replace("{kind: p2os, link: sim}", f"{{kind: p2os, link: {base}}}")
        config.write_text(f"{devices}operator: {operator}\nsocket: {self.folder / 'ctl'}\n")
        return self.start("run", str(config), "--links", str(self.links), *more)

    def until(self, what: Callable[[], bool], seconds: float = 25.0) -> None:
        """Wait until something holds."""
        end = time.monotonic() + seconds
        while not what():
            assert time.monotonic() < end, "it did not come to pass"
            time.sleep(0.05)

    def newest(self) -> Truth:
        """What really is, a moment ago."""
        return truth_log.read(self.truth)[-1]

    def close(self) -> None:
        """End everything."""
        for process in reversed(self.processes):
            process.terminate()
            process.communicate(timeout=10)


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    built = Lab(tmp_path)
    yield built
    built.close()


def last_resort_of(daemon: "subprocess.Popen[bytes]") -> int:
    """Its process."""
    path = Path(f"/proc/{daemon.pid}/task/{daemon.pid}/children")
    (child,) = [
        int(pid)
        for pid in path.read_text().split()
        if b"last_resort" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    return child


def tell(what: str, layer: str, since: float, truths: list[Truth]) -> None:
    """Print which layer stopped the robot, when it began to brake and when it stood."""
    after = [truth for truth in truths if truth.stamp >= since]
    brakes = next(t.stamp for t in after if t.twist.v < after[0].twist.v - 0.05) - since
    stands = next(t.stamp for t in after if abs(t.twist.v) < 1e-3) - since
    sys.stdout.write(f"{what}: stopped by {layer}; brakes {brakes:.2f} s, stands {stands:.2f} s\n")


def distance(a: Truth, b: Truth) -> float:
    return hypot(a.pose.x - b.pose.x, a.pose.y - b.pose.y)


@pytest.mark.parametrize("what", ["daemon", "computer"])
def test_a_killed_daemon_leaves_a_robot_that_stands_until_it_is_armed_again(
    what: str, lab: Lab
) -> None:
    daemon = lab.daemon("auto")
    lab.until(lambda: lab.newest().twist.v > 0.2)
    began = time.monotonic()
    if what == "computer":  # without power nothing but the base's own watchdog is left
        os.kill(last_resort_of(daemon), signal.SIGKILL)
    daemon.send_signal(signal.SIGKILL)
    _, told = daemon.communicate()
    lab.until(lambda: abs(lab.newest().twist.v) < 1e-3)
    time.sleep(1.0)
    assert (b"the daemon is gone" in told) is (what == "daemon")
    layer = "the last resort" if what == "daemon" else "the base's own watchdog"
    tell(f"SIGKILL of the {what}", layer, began, truth_log.read(lab.truth))
    stood = lab.newest()
    lab.daemon("manual")
    time.sleep(6.0)
    after = lab.newest()
    assert distance(stood, after) == 0.0
    assert after.pose.theta == stood.pose.theta


def test_a_frozen_daemon_is_stopped_by_the_last_resort_and_does_not_drive_on_when_it_thaws(
    lab: Lab,
) -> None:
    daemon = lab.daemon("auto")
    lab.until(lambda: lab.newest().twist.v > 0.2)
    began = time.monotonic()
    daemon.send_signal(signal.SIGSTOP)
    lab.until(lambda: abs(lab.newest().twist.v) < 1e-3)
    stood = lab.newest()
    daemon.send_signal(signal.SIGCONT)
    time.sleep(1.0)
    daemon.terminate()
    _, told = daemon.communicate(timeout=10)
    assert b"the loop is blocked" in told  # the layer that stopped it
    assert b"the loop was late" in told
    assert distance(stood, lab.newest()) < 0.05
    tell("SIGSTOP of the daemon", "the last resort", began, truth_log.read(lab.truth))


def test_sigterm_stops_the_robot_before_the_daemon_ends(lab: Lab) -> None:
    summary = lab.folder / "summary.json"
    daemon = lab.daemon("auto", "--summary", str(summary))
    lab.until(lambda: lab.newest().twist.v > 0.2)
    began = time.monotonic()
    daemon.send_signal(signal.SIGTERM)
    assert daemon.wait(timeout=5) == 0
    time.sleep(1.6)  # 0.7 m/s at 0.5 m/s^2
    assert lab.newest().twist.v == pytest.approx(0.0, abs=1e-3)
    tell("SIGTERM", "the daemon", began, truth_log.read(lab.truth))
    figures = json.loads(summary.read_text())
    assert figures["mode_s"]["following"] > 0
    assert figures["follow"] is None  # it could not know the truth


def test_a_daemon_is_told_what_to_do_by_ctl(lab: Lab) -> None:
    lab.daemon("manual")

    def ctl(*words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [*FOLLOWERD, "ctl", *words, "--socket", str(lab.folder / "ctl")],
            capture_output=True,
            text=True,
            check=False,
        )

    lab.until(lambda: "newest_frame" in (out := ctl("status").stdout) and "frame: -" not in out)
    assert "mode: disarmed" in ctl("status").stdout
    refused = ctl("arm")
    assert refused.returncode != 0
    assert "no person enrolled" in refused.stderr
    assert ctl("enrol", "73,11,42,102").returncode == 0
    assert ctl("confirm").returncode == 0
    lab.until(lambda: ctl("arm").returncode == 0)
    lab.until(lambda: lab.newest().twist.v > 0.1)
    assert ctl("stop").returncode == 0
    time.sleep(1.6)
    assert lab.newest().twist.v == pytest.approx(0.0, abs=1e-3)
    assert "mode: estop" in ctl("status").stdout


def test_when_the_simulation_ends_the_daemon_says_which_device_is_lost(lab: Lab) -> None:
    daemon = lab.daemon("auto")
    lab.until(lambda: lab.newest().twist.v > 0.1)
    lab.sim.terminate()
    lab.sim.wait(timeout=5)
    time.sleep(2.0)
    os.kill(daemon.pid, signal.SIGTERM)
    _, told = daemon.communicate(timeout=5)
    assert b'"device": "base"' in told
    assert b"device lost" in told


def test_a_base_that_answers_nothing_is_a_device_error_with_a_remedy(lab: Lab) -> None:
    master, silent = os.openpty()
    daemon = lab.daemon("manual", base=os.ttyname(silent))
    _, told = daemon.communicate(timeout=60)
    os.close(master)
    os.close(silent)
    assert daemon.returncode == 3
    *_, last = told.decode().splitlines()
    assert last.startswith("followerd: base: ")
    assert ";" in last


def test_a_port_that_another_daemon_uses_is_a_device_error(lab: Lab) -> None:
    lab.daemon("auto")
    lab.until(lambda: lab.newest().twist.v > 0.1)
    other = lab.folder / "other.yaml"
    other.write_text(f"{CONFIG}socket: {lab.folder / 'ctl2'}\n")
    second = lab.start("run", str(other), "--links", str(lab.links))
    _, told = second.communicate(timeout=20)
    assert second.returncode == 3
    assert "busy" in told.decode().splitlines()[-1]
    assert lab.newest().twist.v > 0.05
