"""Nonsense for the page: whatever comes through its sockets neither crashes it nor commands.

`python -m tests.page_fuzz 100000` sends that many through real web sockets, and a fifth as many
HTTP requests, to a daemon on its twins; the tests send fewer through sockets.
"""

import asyncio
import json
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import aiohttp
import numpy as np
from aiohttp import WSMessage, WSMsgType, web

from followerd import clock
from followerd.errors import UsageError
from followerd.messages import Mode
from followerd.runtime import logs
from followerd.web.requests import parse
from followerd.web.viewer import BURST, Viewer
from tests.web_page import Served, served

Message = str | bytes

GOOD: tuple[dict[str, Any], ...] = (
    {"do": "ack", "frame": 3},
    {"do": "alive"},
    *({"do": do} for do in ("release", "confirm", "arm", "hold", "disarm", "clear", "manual")),
    {"do": "enrol", "region": [70, 60], "frame": 3},
    {"do": "enrol", "region": [70, 10, 40, 90], "frame": 3},
    {"do": "drive", "forward": 1.0, "left": -1},
    {"do": "record", "on": True},
    {"do": "choose", "tracker": "ofkf"},
)
ODD = (
    "null", "true", "-0", "1e999", "-1e308", "NaN", "Infinity", "9" * 400, '""', '"\\ud800"',
    '"arm"', "[]", "{}", "[" * 900, '{"a":' * 300, '"' + "x" * 3000 + '"', "[1, 2]", "0x10",
)  # fmt: skip
METHODS = 6 * [b"GET"] + 3 * [b"POST"]
METHODS += b"HEAD PUT DELETE OPTIONS PATCH TRACE CONNECT get".split()
TARGETS = (
    b"/", b"/ws", b"/session", b"/scene", b"/metrics", b"/healthz", b"/main.js", b"*", b"//",
    b"/../../etc/passwd", b"/%2e%2e/%2e%2e/etc/passwd", b"/%00", b"/ws?" + b"a=b&" * 300,
    b"http://evil.example/", b"/\xff\xfe", b"/" + b"a" * 9000,
)  # fmt: skip
HEADERS = (
    b"Host: evil.example", b"Host: [", b"Host:", b"Origin: null", b"Origin: http://evil.example",
    b"Content-Length: 5", b"Content-Length: -1", b"Content-Length: 99999999",
    b"Cookie: followerd=x", b"Transfer-Encoding: chunked", b"Upgrade: websocket",
    b"Authorization: Bearer " + b"a" * 500, b"Connection: Upgrade", b"Expect: 100-continue",
    b"Sec-WebSocket-Version: 13", b"Sec-WebSocket-Version: 99", b"Sec-WebSocket-Key: x",
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", b"X: " + b"y" * 9000, b": ", b"\x00: \x01",
    b"Content-Encoding: gzip", b"Range: bytes=0-1,5-",
)  # fmt: skip


def messages(rng: np.random.Generator) -> Iterator[Message]:
    """Without end; none is a request to stop, which everybody may."""
    while True:
        good = json.dumps(GOOD[rng.integers(len(GOOD))])
        match rng.integers(6):
            case 0:
                message: Message = good
            case 1:
                message = _damaged(good.encode(), rng).decode(errors="replace")
            case 2:
                message = _with_odd_value(good, rng)
            case 3:
                message = rng.bytes(int(rng.integers(0, 60))).decode("latin-1")
            case 4:
                message = good[: rng.integers(len(good))] + ODD[rng.integers(len(ODD))]
            case _:
                message = rng.bytes(int(rng.integers(0, 40)))
        if not _is_a_stop(message):
            yield message


def requests(rng: np.random.Generator, host: bytes) -> Iterator[bytes]:
    """HTTP without end; `host` is the one that is served."""
    while True:
        method, target = METHODS[rng.integers(len(METHODS))], TARGETS[rng.integers(len(TARGETS))]
        lines = [b"%s %s HTTP/1.1" % (method, target)]
        if rng.random() < 0.9:
            lines += [b"Host: " + host, b"Origin: http://" + host]
        lines += [HEADERS[k] for k in rng.integers(len(HEADERS), size=rng.integers(3))]
        body = rng.bytes(int(rng.integers(0, 30))) if rng.random() < 0.5 else b""
        if body and rng.random() < 0.8:
            lines.append(b"Content-Length: %d" % len(body))
        request = b"\r\n".join([*lines, b"", body])
        yield _damaged(request, rng) if rng.random() < 0.2 else request


def _damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, left out or said twice."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(out) or 1))
        match rng.integers(3):
            case 0:
                out[at : at + 1] = rng.bytes(1)
            case 1:
                del out[at : at + int(rng.integers(1, 6))]
            case _:
                out[at:at] = out[max(0, at - 4) : at + 4]
    return bytes(out)


def _with_odd_value(good: str, rng: np.random.Generator) -> str:
    content = json.loads(good)
    key = [*content, "more"][rng.integers(len(content) + 1)]
    rest = {k: v for k, v in content.items() if k != key or rng.random() < 0.2}
    said = json.dumps(rest)[:-1] + (", " if rest else "")
    return f'{said}"{key}": {ODD[rng.integers(len(ODD))]}}}'


def _is_a_stop(message: Message) -> bool:
    with suppress(UsageError):
        return isinstance(message, str) and parse(message).do == "stop"
    return False


class Feed(web.WebSocketResponse):
    """A socket that says what it is given, and counts the answers."""

    def __init__(self, said: Iterator[Message]) -> None:
        super().__init__()
        self.said = said
        self.taken = 0
        self.answers: Counter[str] = Counter()

    def __aiter__(self) -> "Feed":
        return self

    async def __anext__(self) -> WSMessage:
        if self.answers["closed"]:
            raise StopAsyncIteration
        message = next(self.said, None)
        if message is None:
            raise StopAsyncIteration
        self.taken += 1
        kind = WSMsgType.TEXT if isinstance(message, str) else WSMsgType.BINARY
        return WSMessage(kind, message, "")

    async def send_str(self, data: str, compress: int | None = None) -> None:
        if data.startswith('{"answer"'):
            self.answers["ok" if json.loads(data)["answer"]["ok"] else "refused"] += 1

    async def send_bytes(
        self, data: bytes | bytearray | memoryview, compress: int | None = None
    ) -> None:
        self.answers["pictures"] += 1

    async def close(self, *, code: int = 1000, message: bytes = b"", drain: bool = True) -> bool:
        self.answers["closed"] += 1
        return True


@dataclass
class Outcome:
    """What came of it."""

    counts: Counter[str] = field(default_factory=Counter)
    errors: list[str] = field(default_factory=list)  # of the loop's own handler


async def fuzz(
    here: Served, rng: np.random.Generator, direct: int, sockets: int, http: int
) -> Outcome:
    """So many messages straight to viewers, through web sockets, and as HTTP requests."""
    outcome = Outcome()
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: outcome.errors.append(str(context)))
    here.page.command.take("somebody", clock.now())
    await _directly(here, rng, direct, outcome)
    await _through_sockets(here, rng, sockets, outcome)
    await _as_http(here, rng, http, outcome)
    decision = here.daemon.decision
    assert decision is not None
    assert decision.mode is Mode.DISARMED, decision
    assert decision.command.stops
    assert not here.daemon.pipeline.modes.enrolled
    assert here.page.switches.recording.recorder is None
    assert not here.chosen
    assert not outcome.errors, outcome.errors[:3]
    assert clock.now() - decision.stamp < 5.0  # it goes on
    return outcome


async def _directly(here: Served, rng: np.random.Generator, count: int, outcome: Outcome) -> None:
    said = messages(rng)
    while outcome.counts["direct"] < count:
        here.page.command.sign("somebody", clock.now())
        feed = Feed(islice(said, int(BURST)))  # more at once are thrown out
        await Viewer("fuzz", feed, here.page.hub, here.page.command, here.page.switches).run()
        outcome.counts["direct"] += feed.taken
        outcome.counts += feed.answers


async def _through_sockets(
    here: Served, rng: np.random.Generator, count: int, outcome: Outcome
) -> None:
    jar = aiohttp.CookieJar(unsafe=True)
    said = messages(rng)
    async with aiohttp.ClientSession(cookie_jar=jar) as session:
        async with session.post(f"{here.address}session", data="", headers=here.origin):
            pass
        while outcome.counts["socket"] < count:
            here.page.command.sign("somebody", clock.now())
            async with session.ws_connect(f"{here.address}ws", headers=here.origin) as socket:
                await _say(socket, islice(said, int(BURST) - 1), outcome)
                if rng.random() < 0.2:
                    writer = socket._writer  # what no client would send
                    writer.transport.write(rng.bytes(int(rng.integers(1, 200))))


async def _say(
    socket: aiohttp.ClientWebSocketResponse, said: Iterator[Message], outcome: Outcome
) -> None:
    for message in said:
        if socket.closed:
            return
        with suppress(ConnectionError):
            if isinstance(message, str):
                await socket.send_str(message)
            else:
                await socket.send_bytes(message)
            outcome.counts["socket"] += 1
    with suppress(TimeoutError):
        while not socket.closed:
            kind = (await socket.receive(0.02)).type
            outcome.counts[f"received {kind.name}"] += 1


async def _as_http(here: Served, rng: np.random.Generator, count: int, outcome: Outcome) -> None:
    host, port = "127.0.0.1", int(here.address.rsplit(":", 1)[1].rstrip("/"))
    for request in islice(requests(rng, f"{host}:{port}".encode()), count):
        here.page.command.sign("somebody", clock.now())
        reader, writer = await asyncio.open_connection(host, port)
        with suppress(OSError, TimeoutError):
            writer.write(request)
            line = await asyncio.wait_for(reader.readline(), 0.05)
            status = line.split(b" ")[1:2]
            outcome.counts[f"status {status[0].decode()}" if status else "no answer"] += 1
            assert status != [b"500"], request
        writer.close()
        outcome.counts["http"] += 1


async def main(count: int, seed: int) -> None:
    """The long run."""
    logs.configure("error")
    async with served() as here:
        await clock.sleep(1.0)
        began = clock.now()
        share = count // 10, count, count // 5
        outcome = await fuzz(here, np.random.default_rng(seed), *share)
        sys.stdout.write(f"{clock.now() - began:.0f} s: {dict(outcome.counts)}\n")


if __name__ == "__main__":
    asyncio.run(main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0))
