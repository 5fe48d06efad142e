"""The operator's page: a small web server in the daemon's loop."""

import asyncio
import logging
import ssl
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import count
from pathlib import Path

import structlog
from aiohttp import web
from aiohttp.http_exceptions import HttpProcessingError
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest

from followerd import app, clock
from followerd.config import Config, WebSection
from followerd.errors import DeviceError
from followerd.messages import Mode
from followerd.runtime.daemon import Daemon
from followerd.web import metrics
from followerd.web.access import COOKIE, Access, Command
from followerd.web.hub import Hub
from followerd.web.requests import LONGEST
from followerd.web.switches import Choice, Switches
from followerd.web.viewer import Viewer
from followerd.web.views import body_view, walls_view

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

STATIC = Path(__file__).parent / "static"
PATIENCE = 3.0  # s without a sign of the one who commands, after which another may
MOST_VIEWERS = 8
ALIVE = 0.5  # s, age of a decision of a daemon that lives
HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' blob:; form-action 'self';"
    " connect-src 'self' ws: wss:; frame-ancestors 'none'; base-uri 'none'",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
}

log = structlog.get_logger()


class Page:
    """Serves one daemon; `choose` starts it anew with another tracker; `tell` is the address."""

    def __init__(
        self,
        daemon: Daemon,
        config: Config,
        settings: WebSection,
        choose: Choice,
        tell: Callable[[str], None],
    ) -> None:
        self.settings = settings
        self.access = Access(settings)
        self.switches = Switches(daemon, config, choose)
        self.command = Command(PATIENCE)
        self.hub = Hub(daemon, settings.jpeg_quality, self.switches.view)
        self._tell = tell
        self._daemon = daemon
        floor = app.floor_of(config)
        self._walls = [] if floor is None else walls_view(floor.walls)
        self._guard = daemon.pipeline.guard
        self._registry = metrics.registry(daemon)
        self._names = count(1)
        self._sockets: set[web.WebSocketResponse] = set()

    async def run(self) -> None:
        """Serve until cancelled. Raises DeviceError when the port is taken."""
        site = web.Application(middlewares=[self._guarded], client_max_size=LONGEST)
        handlers = {
            "/": _file("index.html"),
            "/ws": self._socket,
            "/scene": self._scene,
            "/metrics": self._metrics,
            "/healthz": self._health,
            **{f"/{path.name}": _file(path.name) for path in STATIC.iterdir()},
        }
        routes = [web.get(path, handler) for path, handler in handlers.items()]
        routes += [web.post("/session", self._login), web.route("*", "/{rest:.*}", _nothing)]
        for route in routes:
            site.router.add_route(
                route.method, route.path, route.handler, expect_handler=_unexpected
            )
        runner = web.AppRunner(
            site, access_log=None, logger=_errors(), handle_signals=False, shutdown_timeout=0.5
        )
        await runner.setup()
        self.hub.attach()
        try:
            await self._listen(runner)
            await clock.forever()
        finally:
            for socket in list(self._sockets):
                with suppress(ConnectionError):
                    await clock.within(0.2, socket.close(code=1001, message=b"followerd ends"))
            self.hub.close()
            await runner.cleanup()
            if (recorder := self.switches.recording.stop()) is not None:
                # the loop has a robot to stop meanwhile
                await asyncio.get_running_loop().run_in_executor(None, recorder.close)

    async def _listen(self, runner: web.AppRunner) -> None:
        s = self.settings
        site = web.TCPSite(runner, s.host, s.port, ssl_context=encryption(s))
        try:
            await site.start()
        except OSError as error:
            raise DeviceError(
                "web", f"{s.host}:{s.port}: {error.strerror}", "set web.port, or web: null"
            ) from None
        port = runner.addresses[0][1]
        scheme = "https" if s.certificate else "http"
        host = f"[{s.host}]" if ":" in s.host else s.host
        address = f"{scheme}://{host}:{port}/"
        log.info("page", address=address)
        made = self.access.token and s.token is None  # told once, for nobody else knows it
        self._tell(f"{address}#{self.access.token}" if made else address)

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if refused := self.access.refusal(request):
            return web.json_response({"error": refused}, status=403, headers=HEADERS)
        try:
            response = await handler(request)
        except web.RequestPayloadError as error:
            text = {"error": str(error)}
            return web.json_response(text, status=400, headers=HEADERS)
        except web.HTTPException as error:
            text = {"error": error.reason}
            return web.json_response(text, status=error.status, headers=HEADERS)
        if not response.prepared:
            response.headers.update(HEADERS)
        return response

    async def _login(self, request: web.Request) -> web.StreamResponse:
        """A session; the body is the token."""
        token = (await request.read()).decode(errors="replace")
        session = self.access.login(token, clock.now())
        if session is None:
            return web.json_response({"error": "wrong token"}, status=401)
        response = web.Response(status=204)
        secure = self.settings.certificate is not None
        response.set_cookie(COOKIE, session, httponly=True, samesite="Strict", secure=secure)
        return response

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        if not self.access.admits(request):
            return web.json_response({"error": "log in first"}, status=401)
        if len(self._sockets) >= MOST_VIEWERS:
            return web.json_response({"error": "too many viewers"}, status=503)
        socket = web.WebSocketResponse(compress=False, heartbeat=5.0, max_msg_size=LONGEST)
        await socket.prepare(request)
        self._sockets.add(socket)
        name = f"page {next(self._names)}"
        log.info("viewer", name=name, address=request.remote)
        try:
            await Viewer(name, socket, self.hub, self.command, self.switches).run()
        finally:
            self._sockets.discard(socket)
            log.info("viewer gone", name=name)
        return socket

    async def _scene(self, request: web.Request) -> web.StreamResponse:
        """What does not change: the robot's body, and the map's walls."""
        if not self.access.admits(request):
            return web.json_response({"error": "log in first"}, status=401)
        body = body_view(self._guard.settings)
        return web.json_response({"body": body, "walls": self._walls})

    async def _metrics(self, request: web.Request) -> web.StreamResponse:
        if not self.access.is_local and not self.access.admits(request):
            return web.json_response({"error": "log in first"}, status=401)
        text = generate_latest(self._registry)
        return web.Response(body=text, headers={"Content-Type": CONTENT_TYPE_LATEST})

    async def _health(self, _request: web.Request) -> web.StreamResponse:
        decision = self._daemon.decision
        alive = decision is not None and clock.now() - decision.stamp < ALIVE
        mode = Mode.DISARMED if decision is None else decision.mode
        healthy = alive and mode is not Mode.FAULT
        reasons = [] if decision is None else [str(reason) for reason in decision.reasons]
        text = {"ok": healthy, "mode": mode.value, "reasons": reasons}
        return web.json_response(text, status=200 if healthy else 503)


def _file(name: str) -> Handler:
    async def send(_request: web.Request) -> web.StreamResponse:
        return web.FileResponse(STATIC / name)

    return send


def _errors() -> logging.Logger:
    """Where our own errors are told: what others send that is no HTTP must not fill the journal."""
    logger = logging.getLogger("followerd.http")
    logger.addFilter(_is_ours)
    return logger


def _is_ours(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    theirs = HttpProcessingError | web.RequestPayloadError | ConnectionError
    return not isinstance(error, theirs)


async def _nothing(_request: web.Request) -> web.StreamResponse:
    raise web.HTTPNotFound


async def _unexpected(_request: web.Request) -> None:
    """No page of ours asks whether it may go on; aiohttp's own answer fails on odd characters."""
    raise web.HTTPExpectationFailed


def encryption(settings: WebSection) -> ssl.SSLContext | None:
    """The TLS of the settings, None without; raises DeviceError when its files cannot be used."""
    if settings.certificate is None:
        return None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(settings.certificate, settings.key)
    except (OSError, ssl.SSLError) as error:
        place = f"{settings.certificate} and {settings.key}"
        raise DeviceError("web", f"{place}: {error}", "give PEM files of a pair") from None
    return context
