"""A command imports what it needs and no more: a demonstration starts in half the time."""

import subprocess
import sys

import pytest

NOT_NEEDED = {
    "aiohttp", "foxglove", "mcap", "matplotlib", "playwright", "prometheus_client", "rosbags",
    "scipy", "followerd.hw.camera.kinect", "followerd.trackers.ofkf", "followerd.estimation.mcl",
}  # fmt: skip
DEMO = """
import sys
from followerd.__main__ import call
code = call(["demo", "--virtual", "--headless", "--duration", "0.1"])
print(code, *sorted(sys.modules))
"""


@pytest.mark.slow
def test_a_demonstration_without_page_and_recording_does_not_load_them() -> None:
    done = subprocess.run([sys.executable, "-c", DEMO], capture_output=True, text=True, check=True)
    code, *modules = done.stdout.splitlines()[-1].split()
    assert code == "0"
    assert "followerd.runtime.daemon" in modules
    assert not NOT_NEEDED & set(modules)
