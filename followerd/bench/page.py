"""Suite `page`: what the operator's page and recording cost, and how late the picture is.

In real time, one run after another: the daemon with its twins as a newcomer starts it, a browser,
other viewers or a recording beside it, by turns.
"""

import asyncio
import json
import sys
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory

import aiohttp
import numpy as np

from followerd import clock
from followerd.bench.page_demo import BEGINS, Side, by_turns, demo
from followerd.bench.report import Report
from followerd.bench.rows import Row
from followerd.errors import UsageError
from followerd.geometry import Array

SECONDS, QUICK_SECONDS = 60.0, 15.0  # of each side of a comparison
WATCHED = 45.0  # s of each side at least where p99 is compared: of 15 s it is the third largest
REPLAYED, QUICK_REPLAYED = 600.0, 20.0  # s of virtual time
DRAWS = 5.0  # s that a browser draws before it is measured
COMMAND = "frame_to_command"


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Everything once; neither workers nor seeds. Raises UsageError without a browser."""
    del executor, seeds
    return Report(asyncio.run(_rows(QUICK_SECONDS if quick else SECONDS, quick)))


async def _rows(seconds: float, quick: bool) -> list[Row]:
    with TemporaryDirectory(prefix="followerd-") as name:
        folder = Path(name)
        rows = _delays(np.array(await _drawn(folder, seconds)))
        alone, watched = await by_turns(folder, max(seconds, WATCHED), three_viewers)
        rows += _latency("alone", alone) + _latency("three-viewers", watched)
        more = watched.percentile(COMMAND, 99) / alone.percentile(COMMAND, 99) - 1.0
        rows.append(_row("three-viewers", "frame_to_command_p99_added_percent", 100.0 * more))
        for images in ("jpeg", "exact"):
            alone, with_it = await by_turns(folder, seconds, recorded, "--images", images)
            lag = with_it.percentile("loop_lag", 99) - alone.percentile("loop_lag", 99)
            cpu = with_it.cpu_percent - alone.cpu_percent
            rows += [
                _row(f"record-{images}", "cpu_added_percent", cpu),
                _row(f"record-{images}", "loop_lag_p99_added_ms", lag),
            ]
        rows += await _replayed(folder, QUICK_REPLAYED if quick else REPLAYED)
        return rows


def _delays(stamps: Array) -> list[Row]:
    """Of pictures (N, 6): exposed, in memory, sent, arrived, decoded, drawn; s.

    Captured is what is in memory, as for `frame_to_command`: the camera's own read-out is not ours.
    """
    ends = {
        "capture_to_canvas": (1, 5),
        "exposure_to_canvas": (0, 5),
        "capture_to_sent": (1, 2),
        "sent_to_canvas": (2, 5),
    }
    return [
        _row(
            "canvas",
            f"{name}_p{share}_ms",
            1000.0 * float(np.percentile(stamps[:, last] - stamps[:, first], share)),
        )
        for name, (first, last) in ends.items()
        for share in (50, 95)
    ]


def _row(scenario: str, metric: str, value: float) -> Row:
    unit = "ms" if metric.endswith("_ms") else "%" if metric.endswith("percent") else ""
    return Row("page", scenario, "hpf/default", metric, value, unit)


def _latency(scenario: str, side: Side) -> list[Row]:
    return [
        _row(scenario, f"frame_to_command_p{share}_ms", side.percentile(COMMAND, share))
        for share in (50, 99)
    ]


async def _drawn(folder: Path, seconds: float) -> list[list[float]]:
    """Stamps of the pictures that a browser drew. Raises UsageError without."""
    async with demo(state=folder) as (_, address):
        await clock.sleep(BEGINS)
        shown = await _browse(address, seconds)
    if not shown:
        raise UsageError("the browser drew nothing: is the computer too busy?")
    return shown


@asynccontextmanager
async def three_viewers(address: str) -> AsyncIterator[None]:
    """Two that acknowledge each picture, one that never reads: it stays in the socket."""
    async with AsyncExitStack() as stack:
        for reads in (False, True, True):
            socket = await stack.enter_async_context(_socket(address))
            if reads:
                task = asyncio.create_task(_acknowledge(socket))
                stack.callback(task.cancel)
        yield


async def _acknowledge(socket: aiohttp.ClientWebSocketResponse) -> None:
    async for message in socket:
        if message.type is aiohttp.WSMsgType.BINARY:
            frame = int.from_bytes(message.data[4:8], "little")
            await socket.send_json({"do": "ack", "frame": frame})


@asynccontextmanager
async def recorded(address: str) -> AsyncIterator[None]:
    """Switched on and off as the page does it; nobody looks on meanwhile."""
    await _record(address, on=True)
    try:
        yield
    finally:
        await _record(address, on=False)


async def _record(address: str, *, on: bool) -> None:
    async with _socket(address) as socket:
        for request in ({"do": "command"}, {"do": "record", "on": on}, {"do": "release"}):
            await socket.send_json(request)
        async for message in socket:
            if message.type is not aiohttp.WSMsgType.TEXT:
                continue
            answer = message.json().get("answer")
            if answer is not None and not answer["ok"]:
                raise UsageError(f"{answer['asked']}: {answer['error']}")
            if answer is not None and answer["asked"] == "release":
                return


@asynccontextmanager
async def _socket(address: str) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
    """A session and its socket, as the page opens them."""
    headers = {"Origin": address.rstrip("/")}
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        async with session.post(f"{address}session", data="", headers=headers):
            pass
        async with session.ws_connect(f"{address}ws", headers=headers) as socket:
            yield socket


async def _browse(address: str, seconds: float) -> list[list[float]]:
    """Stamps, s, of pictures on their way to the canvas of a browser on this computer."""
    try:
        from playwright.async_api import async_playwright
    except ImportError:
        raise UsageError("bench page needs playwright: pip install playwright") from None
    chromium = which("chromium") or which("chromium-browser") or which("google-chrome")
    if chromium is None:
        raise UsageError("bench page needs a browser: apt install chromium")
    epoch = clock.epoch()  # the page knows the wall clock only
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium)
        page = await browser.new_page()
        await page.goto(address)
        await clock.sleep(DRAWS)
        await page.evaluate("window.followerd.view.times.length = 0")
        await clock.sleep(seconds)
        times = await page.evaluate("window.followerd.view.times")
        await browser.close()
    return [[*(s + epoch for s in stamps[:3]), *stamps[3:]] for stamps in times]


async def _replayed(folder: Path, seconds: float) -> list[Row]:
    """Replay of an exact recording of a run in virtual time."""
    recording, summary = folder / "long.mcap", folder / "replay.json"
    demo = ["demo", "--virtual", "--headless", "--duration", str(seconds), "--images", "exact"]
    await _call(*demo, "--record", str(recording))
    await _call("replay", str(recording), "--summary", str(summary))
    found = json.loads(summary.read_text())
    same = 100.0 * found["identical"] / found["decisions"]
    return [
        _row("replay", "identical_percent", same),
        _row("replay", "times_real_time", found["times_real_time"]),
    ]


async def _call(*arguments: str) -> None:
    command = [sys.executable, "-m", "followerd", *arguments]
    process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
    _, said = await process.communicate()
    if process.returncode:
        raise UsageError(f"followerd {arguments[0]} failed: {said.decode()[-300:]}")
