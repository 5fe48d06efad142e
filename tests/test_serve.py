"""A twin on a pty and on a TCP port, in real time, seen by a host that knows nothing of it."""

import asyncio
import os
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import numpy as np
import pytest

from followerd import clock
from followerd.errors import LinkLost, OpenError, UsageError
from followerd.hw.serial import open_link
from followerd.hw.stream import ByteStream
from followerd.sim.line import Line
from followerd.sim.serve import on_pty, on_tcp
from tests.test_line import Beacon


def line_of(twin: Beacon) -> Line:
    return Line(twin, np.random.default_rng(0), "robot")


@asynccontextmanager
async def running(line: Line) -> AsyncIterator[None]:
    pump = asyncio.create_task(line.run())
    try:
        yield
    finally:
        pump.cancel()


async def read_exactly(stream: ByteStream, count: int) -> bytes:
    data = b""
    while len(data) < count:
        data += (await stream.read()).data
    return data


async def echoes(stream: ByteStream, telegram: bytes) -> bool:
    stream.write(telegram)
    return await clock.within(5.0, read_exactly(stream, len(telegram))) == telegram


async def test_a_pty_carries_bytes_both_ways_and_disappears_at_the_end(tmp_path: Path) -> None:
    line = line_of(Beacon(baud=38400))
    async with running(line):
        with on_pty(line, tmp_path / "links" / "robot"):
            stream = await open_link(str(tmp_path / "links" / "robot")).open("base", 38400)
            assert await echoes(stream, bytes(range(256)))
            stream.close()
    assert not (tmp_path / "links" / "robot").is_symlink()


async def test_a_host_at_the_wrong_rate_reads_and_writes_garbage_until_it_sets_it(
    tmp_path: Path,
) -> None:
    twin = Beacon(baud=500000)
    line = line_of(twin)
    async with running(line):
        with on_pty(line, tmp_path / "laser"):
            stream = await open_link(str(tmp_path / "laser")).open("laser", 9600)
            assert not await echoes(stream, b"are you there?")
            assert b"are you there?" not in b"".join(h.data for h in twin.heard)
            stream.discard_input()
            stream.set_baud(500000)
            assert await echoes(stream, b"are you there?")
            stream.close()


async def test_bytes_take_their_line_time_there_and_back(tmp_path: Path) -> None:
    line = line_of(Beacon(baud=9600))
    async with running(line):
        with on_pty(line, tmp_path / "robot"):
            stream = await open_link(str(tmp_path / "robot")).open("base", 9600)
            start = clock.now()
            stream.write(bytes(96))
            await read_exactly(stream, 96)
            assert clock.now() - start >= (15 + 96) * 10 / 9600 - 1e-3  # 15 there, then all back
            stream.close()


async def test_what_nobody_reads_is_not_kept_for_the_next_host(tmp_path: Path) -> None:
    twin = Beacon(b"tick", clock.now() + 0.05, baud=9600)
    line = line_of(twin)
    async with running(line):
        with on_pty(line, tmp_path / "robot"):
            first = os.open(tmp_path / "robot", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            await clock.sleep(0.1)
            os.close(first)
            await clock.sleep(0.05)
            second = os.open(tmp_path / "robot", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            with pytest.raises(BlockingIOError):
                os.read(second, 100)
            os.close(second)


async def test_hosts_come_and_go_and_the_session_goes_on(tmp_path: Path) -> None:
    twin = Beacon(baud=500000)
    line = line_of(twin)
    async with running(line):
        with on_pty(line, tmp_path / "robot"):
            for n in range(3):
                stream = await open_link(str(tmp_path / "robot")).open("base", 500000)
                assert await echoes(stream, bytes([n]) * 20)
                stream.close()
                await clock.sleep(0.03)
    assert len(b"".join(h.data for h in twin.heard)) == 60


async def test_no_host_costs_no_time(tmp_path: Path) -> None:
    line = line_of(Beacon(baud=500000))
    async with running(line):
        with on_pty(line, tmp_path / "robot"):
            (await open_link(str(tmp_path / "robot")).open("base", 500000)).close()
            cpu = sum(os.times()[:2])
            await clock.sleep(0.3)
            assert sum(os.times()[:2]) - cpu < 0.1


async def test_a_pulled_cable_is_a_hang_up_and_the_port_comes_back(tmp_path: Path) -> None:
    line = line_of(Beacon(baud=500000))
    async with running(line):
        with on_pty(line, tmp_path / "robot"), on_tcp(line, 0) as port:
            links = [open_link(str(tmp_path / "robot")), open_link(f"socket://127.0.0.1:{port}")]
            streams = [await link.open("base", 500000) for link in links]
            await clock.sleep(0.03)
            line.unplug()
            for stream in streams:
                with pytest.raises(LinkLost):
                    await stream.read()
                stream.close()
            with pytest.raises(OpenError, match="does not exist"):
                await links[0].open("base", 500000)
            line.replug()
            for link in links:
                stream = await link.open("base", 500000)
                assert await echoes(stream, b"back")
                stream.close()
                await clock.sleep(0.03)


async def test_tcp_serves_one_client_at_a_time_and_then_the_next() -> None:
    twin = Beacon(baud=500000)
    line = line_of(twin)
    async with running(line):
        with on_tcp(line, 0) as port:
            link = open_link(f"socket://127.0.0.1:{port}")
            first = await link.open("base", 9600)  # a socket has no rate that could be wrong
            assert await echoes(first, b"first")
            second = await link.open("base", 9600)
            with pytest.raises(LinkLost):
                await second.read()
            second.close()
            first.close()
            await clock.sleep(0.02)
            third = await link.open("base", 9600)
            assert await echoes(third, b"third")
            third.close()


async def test_a_client_that_sends_faster_than_the_line_is_slowed_not_cut() -> None:
    twin = Beacon(baud=500000)
    line = line_of(twin)
    async with running(line):
        with on_tcp(line, 0) as port, socket.create_connection(("127.0.0.1", port)) as client:
            client.setblocking(False)
            data = bytes(range(250)) * 80  # 20 kB, 0.4 s of line; 8 kB are taken at once
            await asyncio.get_running_loop().sock_sendall(client, data)
            while sum(len(h.data) for h in twin.heard) < len(data):
                await clock.sleep(0.05)
    assert b"".join(h.data for h in twin.heard) == data
    assert twin.heard[-1].stamp - twin.heard[0].stamp > 0.3


async def test_a_file_in_the_way_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "robot").write_text("mine")
    with (
        pytest.raises(UsageError, match="in the way"),
        on_pty(line_of(Beacon()), tmp_path / "robot"),
    ):
        pass
    assert (tmp_path / "robot").read_text() == "mine"


async def test_a_name_left_by_a_killed_simulation_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / "robot").symlink_to("/dev/pts/99999")
    line = line_of(Beacon(baud=9600))
    async with running(line):
        with on_pty(line, tmp_path / "robot"):
            stream = await open_link(str(tmp_path / "robot")).open("base", 9600)
            assert await echoes(stream, b"mine now")
            stream.close()


async def test_a_tcp_port_in_use_is_one_clear_error() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        refused = pytest.raises(OpenError, match=r"robot: cannot listen on .*; choose another port")
        with refused, on_tcp(line_of(Beacon()), port):
            pass
