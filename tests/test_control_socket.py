"""The control socket: private, one daemon each, deaf to nonsense."""

import asyncio
import json
import socket
import stat
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from followerd import app, clock
from followerd.config import load
from followerd.errors import DeviceError
from followerd.runtime import logs
from followerd.runtime.control_socket import ask, serve


@asynccontextmanager
async def serving(path: Path) -> AsyncIterator[None]:
    """A daemon that is not running its devices, at its socket."""
    logs.configure("error")
    config = load("hpf-sim")
    daemon = app.build(config, app.in_memory(app.rig(config)))
    task = asyncio.create_task(serve(daemon, path))
    while not path.exists() and not task.done():
        await clock.sleep(0.005)
    yield
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_it_answers_and_only_its_owner_may_speak(tmp_path: Path) -> None:
    path = tmp_path / "run" / "ctl"
    async with serving(path):
        assert (await ask(path, {"do": "status"}))["mode"] == "disarmed"
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert not path.exists()


async def test_a_second_daemon_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "ctl"
    async with serving(path):
        config = load("hpf-sim")
        second = app.build(config, app.in_memory(app.rig(config)))
        with pytest.raises(DeviceError, match="belongs to a running daemon"):
            await serve(second, path)
        assert (await ask(path, {"do": "status"}))["ok"]


async def test_a_socket_left_by_a_killed_daemon_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "ctl"
    with socket.socket(socket.AF_UNIX) as leftover:
        leftover.bind(str(path))
    async with serving(path):
        await clock.sleep(0.05)
        assert (await ask(path, {"do": "status"}))["ok"]


async def test_a_file_in_the_way_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "ctl"
    path.write_text("mine")
    config = load("hpf-sim")
    daemon = app.build(config, app.in_memory(app.rig(config)))
    with pytest.raises(DeviceError, match="is in the way"):
        await serve(daemon, path)
    assert path.read_text() == "mine"


async def test_an_endless_line_hangs_up_that_caller_only(tmp_path: Path) -> None:
    path = tmp_path / "ctl"
    async with serving(path):
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b"x" * 100_000)
        assert await reader.read() == b""
        writer.close()
        assert (await ask(path, {"do": "status"}))["ok"]


async def test_one_connection_may_ask_many_things(tmp_path: Path) -> None:
    path = tmp_path / "ctl"
    async with serving(path):
        reader, writer = await asyncio.open_unix_connection(path)
        for line in (b"nonsense", b'{"do": "status"}', b'{"do": "arm"}'):
            writer.write(line + b"\n")
        answers = [json.loads(await reader.readline())["ok"] for _ in range(3)]
        writer.close()
    assert answers == [False, True, False]
