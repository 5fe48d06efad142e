"""The systemd service: its unit, what it is told, and logs that never hold up the loop."""

import asyncio
import io
import re
import socket
import subprocess
import threading
import time
from contextlib import suppress
from pathlib import Path
from shutil import which

import pytest

from followerd import app, clock, config
from followerd.messages import StopReason
from followerd.runtime import logs
from followerd.runtime.notify import Notify

UNIT = Path(__file__).parent.parent / "systemd/followerd.service"
needs_systemd = pytest.mark.skipif(which("systemd-analyze") is None, reason="no systemd-analyze")


@needs_systemd
def test_the_unit_is_sound(tmp_path: Path) -> None:
    unit = tmp_path / "followerd.service"
    program = "/opt/followerd/.venv/bin/followerd"
    assert f"ExecStart={program} run " in UNIT.read_text()
    unit.write_text(UNIT.read_text().replace(program, "/bin/true"))
    found = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, check=False)
    assert (found.returncode, found.stderr) == (0, b"")


@needs_systemd
def test_the_unit_is_hardened() -> None:
    found = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", UNIT],
        capture_output=True,
        check=False,
        text=True,
    )
    level = re.search(r"Overall exposure level .*: ([\d.]+)", found.stdout)
    assert level
    assert float(level[1]) <= 2.0


def received(manager: socket.socket) -> list[str]:
    """What was said so far."""
    texts = []
    with suppress(BlockingIOError):
        while True:
            texts.append(manager.recv(4096).decode())
    return texts


async def test_systemd_hears_of_the_start_of_life_and_of_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    address = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(address))
        monkeypatch.setenv("WATCHDOG_USEC", "200000")
        chosen = config.load("hpf-sim", {"operator": "manual"})
        world = app.rig(chosen)
        daemon = app.build(chosen, app.in_memory(world))
        running = asyncio.ensure_future(
            clock.together(world.run(), daemon.run(), Notify().run(daemon))
        )
        said: list[str] = []
        for _ in range(100):
            await clock.sleep(0.1)
            said += received(manager)
            if said.count("WATCHDOG=1") >= 3:
                break
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        said += received(manager)
    assert "READY=1" in said
    assert said.count("WATCHDOG=1") >= 3
    assert said[-1] == "STOPPING=1"
    assert any(text.startswith("STATUS=disarmed: ") for text in said)


class Stuck(io.StringIO):
    """A journal that takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.gate = threading.Event()

    def write(self, text: str) -> int:
        self.gate.wait(10.0)
        return super().write(text)


def test_a_reader_of_the_log_that_hangs_holds_nobody_up() -> None:
    journal = Stuck()
    logger = logs.Queued(journal)
    began = time.perf_counter()
    for number in range(5000):
        logger.msg(f"line {number}")
    assert time.perf_counter() - began < 10  # one that waits for the reader never ends
    journal.gate.set()
    logger.close()
    lines = journal.getvalue().splitlines()
    dropped = [int(found[1]) for line in lines if (found := re.search(r"(\d+) log lines", line))]
    assert len(lines) - len(dropped) + sum(dropped) == 5000
    assert sum(dropped) > 2000


def test_the_guide_says_what_to_do_on_each_stop() -> None:
    guide = (UNIT.parent.parent / "docs/operating.md").read_text()
    parts = re.findall(r"^### (\w+)\n(.+)$", guide, re.MULTILINE)
    assert [name for name, _ in parts] == [reason.name for reason in StopReason]
    assert all(len(text) > 30 for _, text in parts)


def test_the_service_is_installed_where_a_package_wants_it(tmp_path: Path) -> None:
    root = UNIT.parent.parent
    command = ["make", "-C", str(root), "install-service", f"DESTDIR={tmp_path}"]
    subprocess.run(command, capture_output=True, check=True)
    assert (tmp_path / "etc/systemd/system/followerd.service").read_text() == UNIT.read_text()
    rules = (tmp_path / "etc/udev/rules.d/60-followerd.rules").read_text()
    assert rules == (UNIT.parent / "60-followerd.rules").read_text()
    assert (tmp_path / "etc/followerd").is_dir()
    again = tmp_path / "etc/udev/rules.d/60-followerd.rules"
    again.write_text("mine")
    subprocess.run(command, capture_output=True, check=True)
    assert again.read_text() == "mine"
