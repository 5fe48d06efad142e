"""A daemon's recording: switched on and off, with a name or without."""

import os
import platform
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import yaml

from followerd import __version__, clock
from followerd.config import Config
from followerd.errors import UsageError
from followerd.hw.camera.calibration import Calibration
from followerd.record.reading import LENS
from followerd.record.recorder import Recorder
from followerd.record.scribe import Scribe
from followerd.record.tape import Tape
from followerd.runtime.daemon import Daemon

UNDER_WAY = "under way"  # of a recording that does not begin with the daemon
LIBRARIES = ("numpy", "opencv-python-headless", "filterpy", "scipy")


class Recording:
    """At most one file at a time; `config` is what the daemon runs on."""

    def __init__(self, daemon: Daemon, config: Config) -> None:
        self._daemon = daemon
        self._config = config
        self.recorder: Recorder | None = None

    @property
    def path(self) -> Path | None:
        """The file that is being written."""
        writing = self.recorder is not None and not self.recorder.stopped
        return self.recorder.tape.path if writing and self.recorder else None

    def start(self, path: Path | None = None, *, file: bool = True) -> None:
        """Begin; without `file` for Foxglove's live view only. Raises UsageError."""
        if self.recorder is not None:
            raise UsageError(f"already recording into {self.recorder.tape.path}")
        if path is None and file:
            path = _named(self._config.record.folder)
        about = described(self._config)
        if self._daemon.decision is not None:
            about["begun"] = UNDER_WAY
        self.recorder = self._opened(path, about)
        for watchers, watch in self._watches(self.recorder):
            watchers.append(watch)

    def _opened(self, path: Path | None, about: dict[str, str]) -> Recorder:
        settings = self._config.record
        if clock.is_virtual():
            return Recorder(Tape(path, settings, about, clock.epoch()), threaded=False)
        if path is not None and path.exists():
            raise UsageError(f"{path} exists; recordings are never overwritten")
        try:
            scribe = Scribe(path, settings, about, clock.epoch())
        except OSError as error:
            raise UsageError(f"nothing can be recorded now: {error.strerror}") from None
        if self._daemon.decision is None:  # then its first images must not be missed
            scribe.wait()
        return Recorder(scribe)

    def stop(self) -> Recorder | None:
        """Take no more; what waits is written by `Recorder.close`, which takes a moment."""
        recorder, self.recorder = self.recorder, None
        if recorder is not None:
            for watchers, watch in self._watches(recorder):
                with suppress(ValueError):
                    watchers.remove(watch)
        return recorder

    def _watches(self, to: Recorder) -> list[tuple[list[Any], Callable[..., None]]]:
        daemon = self._daemon
        return [
            (daemon.measurement_watchers, to.measured),
            (daemon.journal_watchers, to.consumed),
            (daemon.decision_watchers, to.decided),
            (daemon.line_watchers, to.heard),
        ]


def described(config: Config) -> dict[str, str]:
    """What a replay must know of the program and its config."""
    dumped = config.model_dump(mode="json", exclude={"web": {"token"}})
    lens: Calibration | None = getattr(config.camera, "calibration", None)
    bent = lens is not None and any(lens.distortion)
    return {
        "config": yaml.safe_dump(dumped, sort_keys=False),
        "followerd": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        "images": config.record.images,
        **({LENS: lens.model_dump_json()} if lens is not None and bent else {}),
        **{name: version(name) for name in LIBRARIES},
    }


def _named(folder: str | None) -> Path:
    """A file named after the wall clock, in the folder for recordings."""
    states = os.environ.get("STATE_DIRECTORY")
    home = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    place = Path(folder or states or Path(home) / "followerd") / "recordings"
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{place}: {error.strerror}; set record.folder in the config") from None
    return place / f"{datetime.now(UTC):%Y-%m-%dT%H-%M-%S}.mcap"
