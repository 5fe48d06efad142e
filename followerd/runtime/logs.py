"""structlog: JSON lines for the journal, readable lines on a terminal; always on stderr."""

import atexit
import math
import sys
import threading
from collections.abc import Callable
from queue import Empty, Full, Queue
from typing import Any, TextIO

import structlog
from structlog.typing import EventDict, WrappedLogger

LEVELS = {"debug": 10, "info": 20, "warning": 30, "error": 40}


WAITING = 2000  # lines that may wait for a slow reader of stderr
FAREWELL = 0.5  # s for what still waits in the end


def configure(level: str = "info", *, queued: bool = False) -> None:
    """Set up logging once per process; `level` is one of LEVELS.

    `queued`: a thread writes, for a journal that is slow must not hold up the loop.
    """
    terminal = sys.stderr.isatty()
    renderer: structlog.typing.Processor = (
        structlog.dev.ConsoleRenderer()
        if terminal
        else structlog.processors.JSONRenderer(default=_plain)
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            _finite,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(LEVELS[level]),
        logger_factory=_queued() if queued else structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=False,
    )


def _queued() -> Callable[..., "Queued"]:
    logger = Queued(sys.stderr)
    return lambda *_: logger


class Queued:
    """A structlog logger that never blocks who logs; what does not fit is dropped and counted."""

    def __init__(self, file: TextIO) -> None:
        self._file = file
        self._lines: Queue[str] = Queue(WAITING)
        self._dropped = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, name="log", daemon=True)
        self._thread.start()
        atexit.register(self.close)

    def msg(self, line: str) -> None:
        """Queue it."""
        try:
            self._lines.put_nowait(line)
        except Full:
            self._dropped += 1

    debug = info = warning = error = critical = msg

    def close(self) -> None:
        """Write what waits, for a moment at most."""
        self._ending.set()
        self._thread.join(FAREWELL)

    def _work(self) -> None:
        while not (self._ending.is_set() and self._lines.empty()):
            try:
                text = self._lines.get(timeout=0.1)
            except Empty:
                continue
            dropped, self._dropped = self._dropped, 0
            if dropped:
                text += f'\n{{"event": "{dropped} log lines dropped", "level": "warning"}}'
            self._file.write(f"{text}\n")
            self._file.flush()


def _finite(_logger: WrappedLogger, _method: str, event: EventDict) -> EventDict:
    """JSON has no NaN and no infinity."""
    for key, value in event.items():
        if isinstance(value, float) and not math.isfinite(value):
            event[key] = None
    return event


def _plain(value: Any) -> Any:
    return value.tolist() if hasattr(value, "tolist") else repr(value)
