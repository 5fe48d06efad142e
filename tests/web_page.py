"""A daemon with twins in this process, in real time, and its page on a free port."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

import aiohttp

from followerd import app, clock, config
from followerd.config import Config
from followerd.runtime.daemon import Daemon
from followerd.sim.rig import Rig
from followerd.web.hub import HEADER
from followerd.web.server import Page


@dataclass
class Served:
    """What a test needs of it."""

    daemon: Daemon
    world: Rig
    page: Page
    address: str
    chosen: list[str]

    @property
    def origin(self) -> dict[str, str]:
        """Headers of a page that came from here."""
        return {"Origin": self.address.rstrip("/")}


@asynccontextmanager
async def served(changes: dict[str, Any] | None = None, **web: Any) -> AsyncIterator[Served]:
    """Run them until the test is over."""
    chosen = config.load("hpf-sim", {"operator": "manual", **(changes or {})})
    section = config.WebSection(**{"port": 0, **web})
    settings: Config = chosen.model_copy(update={"web": section})
    world = app.rig(settings)
    daemon = app.build(settings, app.in_memory(world))
    told: asyncio.Queue[str] = asyncio.Queue()
    wishes: list[str] = []
    page = Page(daemon, settings, section, wishes.append, told.put_nowait)
    running = asyncio.ensure_future(clock.together(world.run(), daemon.run(), page.run()))
    try:
        address = await asyncio.wait_for(told.get(), 20.0)
        yield Served(daemon, world, page, address, wishes)
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)


@asynccontextmanager
async def opened(where: Served) -> AsyncIterator["Talk"]:
    """A session with a socket, as the page opens it."""
    jar = aiohttp.CookieJar(unsafe=True)  # for an address instead of a name
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        base = where.address.partition("#")[0]
        async with session.post(f"{base}session", data="", headers=where.origin) as answer:
            assert answer.status == 204
        async with session.ws_connect(f"{base}ws", headers=where.origin) as socket:
            yield Talk(socket)


class Talk:
    """Says something and waits for what comes of it."""

    def __init__(self, socket: "aiohttp.ClientWebSocketResponse") -> None:
        self.socket = socket
        self.state: dict[str, Any] = {}
        self.you: dict[str, Any] = {}
        self.track: dict[str, Any] | None = None
        self.frame: int | None = None
        self.sent = 0.0  # s

    async def say(self, do: str, **more: object) -> None:
        """One request."""
        await self.socket.send_json({"do": do, **more})

    async def ask(self, do: str, **more: object) -> dict[str, Any]:
        """One request and its answer."""
        await self.say(do, **more)
        return await self.answer()

    async def newest_frame(self) -> int:
        """The number of a picture that was taken just now; older ones may still be in the pipe."""
        while True:
            await self.next()
            if self.frame is not None and clock.now() - self.sent < 0.2:
                return self.frame

    async def insist(self, do: str) -> None:
        """Ask until it is granted."""
        for _ in range(50):
            if (await self.ask(do))["ok"]:
                return
            await asyncio.sleep(0.2)
        raise AssertionError(f"{do} was never granted")

    async def answer(self) -> dict[str, Any]:
        """The next answer."""
        while True:
            message = await self.next()
            if "answer" in message:
                answer: dict[str, Any] = message["answer"]
                return answer

    async def until(self, mode: str, seconds: float = 10.0) -> None:
        """Wait for a mode, with signs of life meanwhile."""
        async with asyncio.timeout(seconds):
            while self.state.get("mode") != mode:
                await self.next()

    async def next(self) -> dict[str, Any]:
        """The next message; pictures are acknowledged."""
        message = await self.socket.receive(10.0)
        if message.type is aiohttp.WSMsgType.BINARY:
            _, self.frame, *_, self.sent = HEADER.unpack(message.data[: HEADER.size])
            assert message.data[HEADER.size :][:3] == b"\xff\xd8\xff"
            await self.say("ack", frame=self.frame)
            return {}
        assert message.type is aiohttp.WSMsgType.TEXT, message
        content: dict[str, Any] = message.json()
        self.state = content.get("state", self.state)
        self.track = content.get("track", self.track)
        self.you = content if "you" in content else self.you
        if "you" in content:
            await self.say("alive")
        return content
