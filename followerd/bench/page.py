"""Suite `page`: what the operator's page and recording cost, and how late the picture is.

In real time, one run after another: the daemon with its twins as a newcomer starts it, a browser
and other viewers beside it.
"""

import asyncio
import json
import re
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from concurrent.futures import Executor
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from shutil import which
from tempfile import TemporaryDirectory
from typing import Any

import aiohttp
import numpy as np

from followerd import clock
from followerd.bench.report import Report
from followerd.bench.rows import Row
from followerd.errors import UsageError
from followerd.geometry import Array

CAMERA = "640x480@30"
SECONDS, QUICK_SECONDS = 40.0, 12.0
REPLAYED, QUICK_REPLAYED = 600.0, 20.0  # s of virtual time
SETTLED = 5.0  # s that a browser draws before it is measured
Summary = dict[str, Any]


def suite(executor: Executor, seeds: int, quick: bool) -> Report:
    """Everything once; neither workers nor seeds. Raises UsageError without a browser."""
    del executor, seeds
    return Report(asyncio.run(_rows(QUICK_SECONDS if quick else SECONDS, quick)))


async def _rows(seconds: float, quick: bool) -> list[Row]:
    with TemporaryDirectory(prefix="followerd-") as name:
        folder = Path(name)
        alone = await _run(folder, seconds)
        watched = await _run(folder, seconds, viewers=3)
        shown: list[list[float]] = []
        await _run(folder, seconds, shown=shown)
        if not shown:
            raise UsageError("the browser drew nothing: is the computer too busy?")
        rows = [
            *_delays(np.array(shown)),
            *_latency("alone", alone),
            *_latency("three-viewers", watched),
        ]
        for images in ("jpeg", "exact"):
            recorded = await _run(folder, seconds, record=images)
            more = recorded["cpu_percent"] - alone["cpu_percent"]
            lag = recorded["loop_lag_ms"]["p99"] - alone["loop_lag_ms"]["p99"]
            rows += [
                _row(f"record-{images}", "cpu_added_percent", more),
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


def _latency(scenario: str, summary: Summary) -> list[Row]:
    latency = summary["latency_ms"]["frame_to_command"]
    return [_row(scenario, f"frame_to_command_{name}_ms", latency[name]) for name in ("p50", "p99")]


async def _run(
    folder: Path,
    seconds: float,
    *,
    viewers: int = 0,
    shown: list[list[float]] | None = None,
    record: str = "",
) -> Summary:
    """The summary of a demonstration in real time."""
    summary, command = folder / "s.json", ["--camera", CAMERA, "--duration", str(seconds)]
    if record:
        command += ["--record", str(folder / f"{record}.mcap"), "--images", record]
    async with _demo(*command, "--summary", str(summary)) as (process, address):
        beside = [_watch(address, reads=k > 0) for k in range(viewers)]
        if shown is not None:
            beside.append(_browse(address, shown, seconds - SETTLED))
        tasks = [asyncio.create_task(work) for work in beside]
        await process.wait()
        for task in tasks:
            task.cancel()
        for outcome in await asyncio.gather(*tasks, return_exceptions=True):
            if isinstance(outcome, UsageError):
                raise outcome
    found: Summary = json.loads(summary.read_text())
    return found


@asynccontextmanager
async def _demo(*arguments: str) -> AsyncIterator[tuple[Process, str]]:
    """A demonstration, and the address of its page."""
    command = [sys.executable, "-m", "followerd", "demo", *arguments]
    process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
    assert process.stdout is not None
    assert process.stderr is not None
    drain = asyncio.create_task(process.stderr.read())
    try:
        address = ""
        while line := (await process.stdout.readline()).decode():
            if found := re.match(r"page: (\S+)", line):
                address = found[1]
                break
        if not address:
            raise UsageError(f"the demonstration did not start: {(await drain).decode()[-300:]}")
        yield process, address
    finally:
        with suppress(ProcessLookupError):
            process.terminate()
        await process.wait()
        drain.cancel()


async def _watch(address: str, *, reads: bool) -> None:
    """A viewer; one that never reads leaves what it is sent in the socket."""
    headers = {"Origin": address.rstrip("/")}
    jar = aiohttp.CookieJar(unsafe=True)
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        async with session.post(f"{address}session", data="", headers=headers):
            pass
        async with session.ws_connect(f"{address}ws", headers=headers) as socket:
            if not reads:
                await clock.forever()
            async for message in socket:
                if message.type is aiohttp.WSMsgType.BINARY:
                    frame = int.from_bytes(message.data[4:8], "little")
                    await socket.send_json({"do": "ack", "frame": frame})


async def _browse(address: str, shown: list[list[float]], seconds: float) -> None:
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
        await clock.sleep(min(SETTLED, 0.3 * seconds))
        await page.evaluate("window.followerd.view.times.length = 0")
        await clock.sleep(0.4 * seconds)
        times = await page.evaluate("window.followerd.view.times")
        shown += [[*(s + epoch for s in stamps[:3]), *stamps[3:]] for stamps in times]
        await browser.close()


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
