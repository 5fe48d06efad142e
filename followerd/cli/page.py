"""The operator's page beside a running daemon, and what it does when another tracker is chosen."""

import socket
from collections.abc import Callable

from followerd import app, clock
from followerd import config as configs
from followerd.config import Config
from followerd.runtime.daemon import Daemon


class Anew(Exception):
    """The daemon is to start again, with another config."""

    def __init__(self, config: Config) -> None:
        super().__init__(config.tracker.kind)
        self.config = config


class Opened:
    """A page for one daemon; `tell` is given its address."""

    def __init__(self, config: Config, tell: Callable[[str], None]) -> None:
        self._config = config
        self._tell = tell
        self._chosen: Config | None = None

    async def run(self, daemon: Daemon) -> None:
        """Serve until cancelled; raises Anew, or DeviceError when the port is taken."""
        # a quarter of a second, which a command without a page need not wait
        from followerd.web.server import Page

        settings = self._config.web
        assert settings is not None
        page = Page(daemon, self._config, settings, self._choose, self._tell)
        await clock.together(page.run(), self._wait())

    async def _wait(self) -> None:
        while self._chosen is None:
            await clock.sleep(0.05)
        raise Anew(self._chosen)

    def _choose(self, tracker: str) -> None:
        chosen = configs.with_tracker(self._config, tracker)
        app.verify(chosen)
        self._chosen = chosen


def on_a_free_port(config: Config) -> Config:
    """For a demonstration: where something else listens on the page's port, on any free one."""
    if config.web is None:
        return config
    with socket.socket() as trial:
        trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            trial.bind((config.web.host, config.web.port))
        except OSError:
            web = config.web.model_copy(update={"port": 0})
            return config.model_copy(update={"web": web})
    return config
