"""What a lab's own tests get: twins in a process, on ports, that fail when they are told to."""

import os
import subprocess
import sys
from collections.abc import Callable

import pytest

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.serial import open_link
from followerd.pytest_plugin import Simulation
from tests.test_line import read_for_ever

pytestmark = pytest.mark.slow


def test_twins_stand_on_ports_and_fail_when_told(simulation: Callable[..., Simulation]) -> None:
    twins = simulation("corridor", "--seed", "3")
    with pytest.raises(ValueError, match="no fault 'dead'; there are off, stuck"):
        twins.fail("laser:dead+1s")

    async def client() -> None:
        stream = await open_link(str(twins.links / "robot")).open("base", 9600)
        stream.write(bytes.fromhex("FA FB 03 00 00 00"))  # SYNC0
        assert b"\xfa\xfb" in (await stream.read()).data
        twins.fail("robot:disconnect+60s")
        with pytest.raises(LinkLost):
            await read_for_ever(stream)
        stream.close()

    clock.run(client())
    assert not os.path.lexists(twins.links / "robot")


def test_faults_come_from_another_shell(simulation: Callable[..., Simulation]) -> None:
    twins = simulation()

    def fault(*texts: str) -> "subprocess.CompletedProcess[str]":
        command = [sys.executable, "-m", "followerd", "fault", str(twins.links), *texts]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    done = fault("laser:disconnect+60s", "base:off@100s+2s")
    assert done.returncode == 0
    assert "base:off@100s+2s: from 100.0 s to 102.0 s" in done.stdout
    assert not os.path.lexists(twins.links / "laser")
    refused = fault("base:off@0s+0.1s")
    assert refused.returncode == 2
    assert "is over: the simulation is at" in refused.stderr
