"""`--record F` of the commands that run a daemon."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd.app import Attach
from followerd.config import Config
from followerd.errors import UsageError
from followerd.runtime.daemon import Daemon

RecordFile = Annotated[
    Path | None, Parameter(help="record the run into this *.mcap (config: record)")
]


@contextmanager
def recorded(path: Path | None, config: Config) -> Iterator[list[Attach]]:
    """What attaches the recorder, if one is wanted; closes the file in the end.

    A daemon that starts anew, with another tracker, is recorded into NAME.2.mcap and so on.
    """
    wanted = path is not None or config.record.foxglove_port is not None
    if path is not None and (path.suffix != ".mcap" or not path.parent.is_dir() or path.exists()):
        raise UsageError(f"--record {path}: give a new file *.mcap in a folder that exists")
    starts = count(1)
    with ExitStack() as ending:

        def attach(daemon: Daemon) -> None:
            # only what is recorded needs Foxglove's library
            from followerd.runtime.recording import Recording

            recording = Recording(daemon, config)
            number = next(starts)
            place = path
            if path is not None and number > 1:
                place = path.with_stem(f"{path.stem}.{number}")
            recording.start(place, file=path is not None)
            recorder = recording.recorder
            assert recorder is not None

            def end() -> None:
                recorder.close()
                if recorder.stopped:
                    print(recorder.stopped)

            ending.callback(end)

        yield [attach] if wanted else []
