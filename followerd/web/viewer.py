"""One open page: what it is shown, and what it asks for."""

import asyncio
import json
from contextlib import suppress
from typing import Any

from aiohttp import WSMsgType, web

from followerd import clock
from followerd.control.transitions import Action
from followerd.errors import FollowerdError, UsageError
from followerd.events import Hand, Presence
from followerd.messages import Image, Twist
from followerd.web.access import Command
from followerd.web.hub import Hub
from followerd.web.requests import Ack, Act, Alive, Choose, Drive, Enrol, Record, parse
from followerd.web.switches import Switches

RATE, BURST = 80.0, 160.0  # messages a second, and at once
BAD = 20  # malformed messages in a row, after which it is no page of ours
ACTIONS = {action.value: action for action in Action}


class Viewer:
    """A socket and its tasks; a viewer that does not read only waits for itself."""

    def __init__(
        self,
        name: str,
        socket: web.WebSocketResponse,
        hub: Hub,
        command: Command,
        switches: Switches,
    ) -> None:
        self.name = name
        self._socket = socket
        self._hub = hub
        self._command = command
        self._switches = switches
        self._changed = asyncio.Event()
        self._drawn = True  # the page has drawn what it was sent
        self._budget, self._counted = BURST, clock.now()
        self._enrolling: asyncio.Task[None] | None = None

    async def run(self) -> None:
        """Until the socket closes."""
        self._hub.join(self._changed.set)
        showing = asyncio.create_task(self._show())
        try:
            await self._listen()
        finally:
            self._hub.viewers.discard(self._changed.set)
            showing.cancel()
            await asyncio.gather(showing, return_exceptions=True)
            if self._command.give_up(self.name):
                self._hub.daemon.handle(Presence(self.name, here=False))

    async def _show(self) -> None:
        """The newest state and track, and the newest picture once the last one is drawn."""
        shown: Image | None = None
        state = track = ""
        while True:
            if self._hub.state != state:
                state = self._hub.state
                await self._socket.send_str(state)
                await self._introduce()
            if self._hub.track != track:
                track = self._hub.track
                await self._socket.send_str(track)
            image = self._hub.image
            if self._drawn and image is not None and image is not shown:
                shown, self._drawn = image, False
                await self._socket.send_bytes(await self._hub.picture(image))
            await self._changed.wait()
            self._changed.clear()

    async def _introduce(self) -> None:
        """Tell the page its name, and who commands."""
        mine = {"you": self.name, "commander": self._command.holder or None}
        await self._socket.send_str(json.dumps(mine))

    async def _listen(self) -> None:
        bad = 0
        async for message in self._socket:
            if not self._within_rate():
                await self._socket.close(code=1008, message=b"too many messages")
                return
            if message.type is not WSMsgType.TEXT:
                bad += 1
                await self._answer("", "messages are JSON text")
            else:
                try:
                    answer = self._do(message.data)
                    bad = 0
                    if answer is not None:
                        await self._answer(*answer)
                except UsageError as error:
                    bad += 1
                    await self._answer("", str(error))
            if bad >= BAD:
                await self._socket.close(code=1008, message=b"not a page of this robot")
                return

    def _within_rate(self) -> bool:
        now = clock.now()
        self._budget = min(BURST, self._budget + RATE * (now - self._counted)) - 1.0
        self._counted = now
        return self._budget >= 0.0

    def _do(self, text: str) -> tuple[str, str] | None:
        """What was asked for and why it was refused, if there is something to say.

        Raises UsageError when it is no request.
        """
        request, now = parse(text), clock.now()
        if isinstance(request, Ack):
            self._drawn = True
            self._changed.set()
            return None
        if isinstance(request, Alive):
            if self._command.sign(self.name, now):
                self._hub.daemon.handle(Presence(self.name))
            return None
        if isinstance(request, Act) and request.do == "stop":  # anybody may
            return "stop", self._hub.daemon.act(Action.STOP, self.name)
        if isinstance(request, Act) and request.do == "command":
            taken = self._command.take(self.name, now)
            return "command", "" if taken else "somebody else commands"
        if not self._command.sign(self.name, now):
            return request.do, "take the command first: others may only look and stop"
        self._hub.daemon.handle(Presence(self.name))
        if isinstance(request, Drive):
            fastest = self._switches.fastest
            wanted = Twist(request.forward * fastest.v, request.left * fastest.omega)
            self._hub.daemon.handle(Hand(self.name, wanted))
            return None
        if isinstance(request, Enrol):
            return self._enrol(request)
        if isinstance(request, Record):
            return "record", self._switches.record(on=request.on)
        if isinstance(request, Choose):
            return "choose", self._switches.choose(request.tracker)
        return self._act(request)

    def _act(self, request: Act) -> tuple[str, str]:
        if request.do == "release":
            self._command.give_up(self.name)
            self._hub.daemon.handle(Presence(self.name, here=False))
            return "release", ""
        return request.do, self._hub.daemon.act(ACTIONS[request.do], self.name)

    def _enrol(self, request: Enrol) -> tuple[str, str] | None:
        if self._enrolling is not None and not self._enrolling.done():
            return "enrol", "still looking at the one before"
        place = request.place

        async def enrol() -> None:
            refused = ""
            try:
                await self._hub.daemon.enrol(place, request.frame)
            except FollowerdError as error:
                refused = str(error)
            await self._answer("enrol", refused)

        self._enrolling = asyncio.create_task(enrol())
        return None

    async def _answer(self, asked: str, refused: str) -> None:
        answer: dict[str, Any] = {"asked": asked, "ok": not refused}
        if refused:
            answer["error"] = refused
        with suppress(ConnectionError):
            await self._socket.send_str(json.dumps({"answer": answer}))
