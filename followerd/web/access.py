"""Who may see the page, and who of them may command."""

import hmac
import secrets
from collections import deque
from dataclasses import dataclass, field
from ipaddress import ip_address
from urllib.parse import urlsplit

from aiohttp import web

from followerd.config import WebSection

COOKIE = "followerd"
LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
TRIES, PER = 5, 60.0  # log-ins with a wrong token, in so many seconds
MOST_SESSIONS = 64


@dataclass
class Access:
    """Tokens, sessions, and the headers of a request; holds no connection.

    On the loopback address everybody on this computer may look and command; elsewhere whoever
    knows the token. A page of somebody else's may not speak through a browser: Host and Origin are
    checked, for a name that is rebound to this address still arrives as a name.
    """

    settings: WebSection
    token: str = ""
    _sessions: dict[str, None] = field(default_factory=dict)
    _failures: deque[float] = field(default_factory=deque)

    def __post_init__(self) -> None:
        if not self.is_local and not self.token:
            self.token = self.settings.token or secrets.token_urlsafe(24)

    @property
    def is_local(self) -> bool:
        """Whether only this computer can connect."""
        return self.settings.host in LOCAL_NAMES

    def refusal(self, request: web.Request) -> str:
        """What is wrong with where a request comes from; empty: nothing."""
        host = _name(f"//{request.headers.get('Host', '')}")
        if not self._is_ours(host):
            return "unknown Host; add it to web.names in the config"
        origin = request.headers.get("Origin")
        needs = request.method != "GET" or request.path == "/ws"
        if needs and (origin is None or urlsplit(origin).netloc != request.headers.get("Host")):
            return "a request of another page"
        return ""

    def login(self, token: str, now: float) -> str | None:
        """A new session for who knows the token; None: refused."""
        while self._failures and self._failures[0] < now - PER:
            self._failures.popleft()
        if len(self._failures) >= TRIES:
            return None
        if not self.is_local and not hmac.compare_digest(token.encode(), self.token.encode()):
            self._failures.append(now)
            return None
        session = secrets.token_urlsafe(24)
        self._sessions[session] = None
        while len(self._sessions) > MOST_SESSIONS:
            del self._sessions[next(iter(self._sessions))]
        return session

    def admits(self, request: web.Request) -> bool:
        """Whether a request belongs to a session, or carries the token itself."""
        if request.cookies.get(COOKIE, "") in self._sessions:
            return True
        kind, _, token = request.headers.get("Authorization", "").partition(" ")
        if kind != "Bearer" or not self.token:
            return False
        return hmac.compare_digest(token.encode(), self.token.encode())

    def _is_ours(self, host: str) -> bool:
        if host in LOCAL_NAMES or host in self.settings.names:
            return True
        try:
            ip_address(host)
        except ValueError:
            return False
        return not self.is_local


def _name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


class Command:
    """At most one viewer commands; the others look on, and may press the emergency stop."""

    def __init__(self, patience: float) -> None:
        self.holder = ""
        self._patience = patience  # s without a sign of the holder
        self._seen = 0.0  # s

    def take(self, viewer: str, now: float) -> bool:
        """Whether `viewer` commands from now on."""
        if self.holder in ("", viewer) or now - self._seen > self._patience:
            self.holder, self._seen = viewer, now
        return self.holder == viewer

    def sign(self, viewer: str, now: float) -> bool:
        """A sign of life; whether it is the holder's."""
        if viewer and viewer == self.holder:
            self._seen = now
            return True
        return False

    def give_up(self, viewer: str) -> bool:
        """Whether it was the holder's to give."""
        held = viewer == self.holder
        if held:
            self.holder = ""
        return held
