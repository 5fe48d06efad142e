"""`--record F` of the commands that run a daemon."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd.app import Attach
from followerd.config import Config
from followerd.errors import UsageError
from followerd.record.recorder import Recorder
from followerd.runtime.daemon import Daemon
from followerd.runtime.recording import Recording

RecordFile = Annotated[
    Path | None, Parameter(help="record the run into this *.mcap (config: record)")
]


@contextmanager
def recorded(path: Path | None, config: Config) -> Iterator[list[Attach]]:
    """What attaches the recorder, if one is wanted; closes the file in the end."""
    wanted = path is not None or config.record.foxglove_port is not None
    if path is not None and (path.suffix != ".mcap" or not path.parent.is_dir() or path.exists()):
        raise UsageError(f"--record {path}: give a new file *.mcap in a folder that exists")
    recorders: list[Recorder] = []

    def attach(daemon: Daemon) -> None:
        recording = Recording(daemon, config)
        recording.start(path, file=path is not None)
        assert recording.recorder is not None
        recorders.append(recording.recorder)

    try:
        yield [attach] if wanted else []
    finally:
        for recorder in recorders:
            recorder.close()
            if recorder.stopped:
                print(recorder.stopped)
