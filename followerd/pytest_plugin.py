"""Twins for the tests of any program that speaks to these devices.

Put `pytest_plugins = ["followerd.pytest_plugin"]` into your conftest.py; then

    def test_my_program_survives_noise(simulation):
        twins = simulation("corridor")
        start_my_program(twins.links / "laser")  # a pty, as a serial port
        twins.fail("laser:garbage+2s")
"""

import json
import socket
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from followerd.sim import truth_log
from followerd.sim.truth import Truth

ANSWER = 5.0  # s


class Simulation:
    """A `followerd sim` in a process of its own."""

    def __init__(self, scenario: str, folder: Path, *options: str) -> None:
        """Returns when its ports are there; `options` as on the command line."""
        self.links = folder / "links"  # robot, laser, camera
        truth = folder / "truth.jsonl"
        self._tail = truth_log.Tail(truth)
        command = [sys.executable, "-m", "followerd", "sim", scenario, *options]
        command += ["--links", str(self.links), "--truth", str(truth), "--until-eof"]
        self._process = Popen(command, stdin=PIPE, stdout=PIPE, text=True)
        told = iter(self._process.stdout or ())
        assert any("are in" in line for line in told), "the simulation did not start"

    def fail(self, fault: str) -> None:
        """Let a device fail, `laser:off+2s` at once; raises ValueError."""
        with socket.socket(socket.AF_UNIX) as control:
            control.settimeout(ANSWER)
            control.connect(str(self.links / "control"))
            control.sendall(json.dumps({"fault": fault}).encode() + b"\n")
            answer = json.loads(control.makefile().readline())
        if not answer["ok"]:
            raise ValueError(answer["error"])

    def newest(self) -> Truth | None:
        """What really is, 0.1 s late; None at first."""
        return self._tail.newest()

    def close(self) -> None:
        """End it."""
        self._process.terminate()
        self._process.communicate()


@pytest.fixture
def simulation(tmp_path: Path) -> Iterator[Callable[..., Simulation]]:
    """Starts twins: `simulation(SCENARIO, *OPTIONS)`; they end with the test."""
    running: list[Simulation] = []

    def start(scenario: str = "corridor", *options: str) -> Simulation:
        folder = tmp_path / f"simulation{len(running)}"
        folder.mkdir()
        running.append(Simulation(scenario, folder, *options))
        return running[-1]

    yield start
    for each in running:
        each.close()
