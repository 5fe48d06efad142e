"""The operator's page in a real browser: a Chromium beside the real daemon."""

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from shutil import which

import numpy as np
import pytest
from playwright.async_api import Browser, Page, async_playwright

from followerd import clock
from followerd.messages import Command, Mode
from followerd.record.journal import Enrolled
from tests.web_page import Served, served

CHROMIUM = which("chromium") or which("chromium-browser") or which("google-chrome")
PHONE = {"width": 390, "height": 844}
DESK = {"width": 1280, "height": 900}

pytestmark = [
    pytest.mark.slow,
    pytest.mark.realtime,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt install chromium"),
]


@asynccontextmanager
async def browsing() -> AsyncIterator[Browser]:
    """A browser for one test."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(
            executable_path=CHROMIUM, args=["--disable-dev-shm-usage"]
        )
        try:
            yield browser
        finally:
            await browser.close()


async def visit(browser: Browser, here: Served, size: dict[str, int] = DESK) -> Page:
    """Open the page and wait for its first picture; an error on the page fails the test."""
    context = await browser.new_context(viewport={"width": size["width"], "height": size["height"]})
    page = await context.new_page()
    page.on("pageerror", _fail)
    await page.goto(here.address)
    await until(page, "window.followerd?.view.drawn > 2", 20.0)
    return page


async def until(page: Page, script: str, seconds: float = 10.0) -> None:
    """Wait until that is so; Playwright's own waiting needs what the page's policy forbids."""
    for _ in range(round(20 * seconds)):
        if await page.evaluate(script):
            return
        await asyncio.sleep(0.05)
    raise AssertionError(f"never: {script}; the page says {await page.inner_text('body')}")


def _fail(error: object) -> None:
    raise AssertionError(f"the page has an error: {error}")


async def mode_is(page: Page, mode: str, seconds: float = 10.0) -> None:
    """Wait until the page shows that mode."""
    await until(page, f"document.getElementById('mode').textContent === '{mode}'", seconds)


async def click_on_the_person(page: Page, here: Served) -> None:
    """Where the world has them in the picture that is on the screen."""
    await click_at(page, 94.0 / 192.0, 55.0 / 144.0)  # who stands before the robot at the start


async def click_at(page: Page, x: float, y: float) -> None:
    """At these shares of the picture's width and height."""
    area = await page.locator("#picture").bounding_box()
    assert area is not None
    await page.mouse.click(area["x"] + x * area["width"], area["y"] + y * area["height"])


async def press(page: Page, name: str) -> None:
    """A button, again and again until it is granted."""
    for _ in range(40):
        await page.click(f"button[data-do={name}]")
        await asyncio.sleep(0.25)
        if not await page.inner_text("#answer"):
            return
    raise AssertionError(await page.inner_text("#answer"))


async def follow(page: Page, here: Served) -> None:
    """What an operator does: click on the person, confirm, follow."""
    await asyncio.sleep(2.0)
    await click_on_the_person(page, here)
    await until(page, "window.followerd.view.track?.box")
    await press(page, "confirm")
    await press(page, "arm")
    await mode_is(page, "following", 15.0)


async def drives(here: Served) -> None:
    """Wait until the robot moves."""
    for _ in range(500):
        if here.world.world.truth().twist.v > 0.0:
            return
        await asyncio.sleep(0.02)
    raise AssertionError("the robot never moved")


async def test_click_confirm_follow_and_stop_by_the_space_bar(tmp_path: Path) -> None:
    async with served() as here, browsing() as browser:
        page = await visit(browser, here)
        await follow(page, here)
        await asyncio.sleep(2.0)
        # PAGE_SCREENSHOT=docs/page.png makes the README's picture
        await page.screenshot(path=os.environ.get("PAGE_SCREENSHOT", tmp_path / "page.png"))
        assert await page.inner_text("#who") == "you command"
        await page.keyboard.press("Space")
        await mode_is(page, "estop")
        assert here.daemon.decision is not None
        assert here.daemon.decision.command.stops
        assert "emergency stop" in await page.inner_text("#reasons")


async def test_in_a_moving_scene_a_click_enrols_whoever_was_clicked() -> None:
    async with served() as here, browsing() as browser:
        page = await visit(browser, here)
        await follow(page, here)
        await asyncio.sleep(3.0)  # robot and person walk down the corridor
        await press(page, "disarm")
        x, y, w, h = await page.evaluate("window.followerd.view.track.box")
        enrolments: list[Enrolled] = []
        here.daemon.journal_watchers.append(
            lambda entry: enrolments.append(entry) if isinstance(entry, Enrolled) else None
        )
        await click_at(page, (x + 0.5 * w) / 192.0, (y + 0.5 * h) / 144.0)
        await until(page, "window.followerd.view.track?.phase === 'confirmed'")
        await press(page, "confirm")
        decision, person = here.daemon.decision, here.world.world.truth().target
        assert enrolments[0].frame_id is not None
        assert decision is not None
        assert decision.track is not None
        assert decision.track.position is not None
        at = here.daemon.pipeline.ego_at(clock.now())
        assert at is not None
        there = at.apply_point(*(~here.world.world.pose).apply_point(person.x, person.y))
        assert np.hypot(*np.subtract(decision.track.position, there)) < 0.5


async def test_the_big_button_stops_on_a_phone(tmp_path: Path) -> None:
    async with served() as here, browsing() as browser:
        page = await visit(browser, here, PHONE)
        width = await page.evaluate("document.documentElement.scrollWidth")
        assert width <= PHONE["width"]  # nothing to scroll sideways to
        await follow(page, here)
        stop = await page.locator("#stop").bounding_box()
        assert stop is not None
        assert stop["height"] > 60
        assert stop["y"] + stop["height"] <= PHONE["height"]  # always in sight
        await page.click("#stop")
        await mode_is(page, "estop")
        await page.screenshot(path=os.environ.get("PHONE_SCREENSHOT", tmp_path / "phone.png"))


async def test_a_second_commander_is_refused_and_may_still_stop() -> None:
    async with served() as here, browsing() as browser:
        first, second = await visit(browser, here), await visit(browser, here)
        await press(first, "command")
        await until(
            second, "document.getElementById('who').textContent === 'somebody else commands'"
        )
        await second.click("button[data-do=command]")
        await until(second, "document.getElementById('answer').textContent")
        assert await second.is_disabled("button[data-do=arm]")
        await second.click("#stop")
        await mode_is(first, "estop")


async def test_a_closed_page_that_commanded_stops_the_robot() -> None:
    async with served() as here, browsing() as browser:
        page = await visit(browser, here)
        await follow(page, here)
        await page.close()
        await asyncio.sleep(1.0)
        assert here.daemon.decision is not None
        assert here.daemon.decision.mode is Mode.DISARMED


async def test_driving_by_hand_ends_with_the_key() -> None:
    async with served() as here, browsing() as browser:
        page = await visit(browser, here)
        await asyncio.sleep(2.0)
        await press(page, "manual")
        await mode_is(page, "manual")
        await page.keyboard.down("ArrowUp")
        await asyncio.sleep(1.5)
        assert here.daemon.decision is not None
        assert not here.daemon.decision.command.stops
        await page.keyboard.up("ArrowUp")
        await asyncio.sleep(0.4)
        assert here.daemon.decision.command.stops


async def test_the_page_comes_back_after_the_daemon() -> None:
    async with browsing() as browser:
        async with served() as here:
            page = await visit(browser, here)
            port = int(here.address.rsplit(":", 1)[1].rstrip("/"))
        await mode_is(page, "gone")
        async with served(port=port):
            await mode_is(page, "disarmed")
            drawn = await page.evaluate("window.followerd.view.drawn")
            await until(page, f"window.followerd.view.drawn > {drawn}")


async def test_what_is_recorded_from_the_page_is_a_recording(tmp_path: Path) -> None:
    async with (
        served({"record.folder": str(tmp_path)}) as here,
        browsing() as browser,
    ):
        page = await visit(browser, here)
        await page.click("#record")
        await until(page, "document.getElementById('record').textContent !== 'Record'")
        await asyncio.sleep(1.0)
        await page.click("#record")
        await until(page, "document.getElementById('record').textContent === 'Record'")
        for _ in range(200):  # till the process that writes it has finished
            await asyncio.sleep(0.05)
            if [path.stat().st_size > 10_000 for path in tmp_path.rglob("*.mcap")] == [True]:
                return
        raise AssertionError("nothing was recorded")


async def test_a_click_on_stop_is_zero_on_the_wire_at_once() -> None:
    """ESTOP_PRESSES=100 measures: the bar is a tenth of a second on an idle computer."""
    presses = int(os.environ.get("ESTOP_PRESSES", "4"))
    async with served() as here, browsing() as browser:
        page = await visit(browser, here)
        await page.evaluate(
            "document.getElementById('stop').addEventListener('pointerdown', () => {"
            " window.pressed = (performance.timeOrigin + performance.now()) / 1000; })"
        )
        stops, sent = list[float](), asyncio.Event()
        noted = here.daemon.base.on_sent

        def note(command: Command, stamp: float) -> None:
            noted(command, stamp)
            if command.emergency:
                stops.append(stamp + clock.epoch())
                sent.set()

        here.daemon.base.on_sent = note
        await asyncio.sleep(2.0)
        delays = []
        for _ in range(presses):
            await press(page, "manual")
            await mode_is(page, "manual")
            await page.keyboard.down("ArrowUp")
            await drives(here)
            stops.clear()
            sent.clear()
            await page.click("#stop")
            await page.keyboard.up("ArrowUp")
            await mode_is(page, "estop")
            await asyncio.wait_for(sent.wait(), 10.0)
            delays.append(stops[0] - await page.evaluate("window.pressed"))
            await press(page, "clear")
        figures = np.percentile(1000.0 * np.array(delays), [50, 99, 100])
        print(f"{presses} presses: p50, p99, max {figures.round(1)} ms")  # noqa: T201 measured so
        assert min(delays) > -0.01
        assert max(delays) < 1.0  # what no computer that also runs the tests exceeds
