"""What the page switches besides the robot: recording, and the choice of a tracker."""

import asyncio
from collections.abc import Callable
from math import radians
from typing import Any

from followerd.config import Config
from followerd.control.transitions import ARMED
from followerd.errors import FollowerdError
from followerd.messages import Twist
from followerd.runtime.daemon import Daemon
from followerd.runtime.recording import Recording
from followerd.trackers.registry import TRACKERS

Choice = Callable[[str], None]  # raises FollowerdError when it cannot be


class Switches:
    """`choose` starts the daemon anew with another tracker."""

    def __init__(self, daemon: Daemon, config: Config, choose: Choice) -> None:
        self._daemon = daemon
        self._config = config
        self._choose = choose
        self.recording = Recording(daemon, config)

    @property
    def fastest(self) -> Twist:
        """Driven by hand."""
        settings = self._config.pipeline
        turn = radians(0.5 * settings.guard.max_turn_degps)
        return Twist(settings.modes.manual_speed_mps, turn)

    def record(self, *, on: bool) -> str:
        """Begin or end a recording; why not, or nothing."""
        try:
            if on:
                self.recording.start()
            elif (recorder := self.recording.stop()) is not None:
                asyncio.get_running_loop().run_in_executor(None, recorder.close)
        except FollowerdError as error:
            return str(error)
        return ""

    def choose(self, tracker: str) -> str:
        """Why not, or nothing."""
        mode = None if self._daemon.decision is None else self._daemon.decision.mode
        if mode in ARMED:
            return "disarm first"
        try:
            self._choose(tracker)
        except FollowerdError as error:
            return str(error)
        return ""

    def view(self) -> dict[str, Any]:
        """For the page."""
        recorder, path = self.recording.recorder, self.recording.path
        return {
            "recording": None if path is None else path.name,
            "recording_stopped": "" if recorder is None else recorder.stopped,
            "tracker": self._config.tracker.kind,
            "trackers": TRACKERS.names(),
        }
