"""`followerd export` and `import`: to and from ROS."""

from itertools import count
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from rich.progress import Progress

from followerd import config as configs
from followerd.errors import UsageError
from followerd.messages import Image
from followerd.record import ros_export, ros_import
from followerd.record.journal import Looked, Taken
from followerd.record.reading import Recording
from followerd.record.settings import RecordSettings
from followerd.record.tape import Tape
from followerd.runtime.recording import described


def export(rec: Path, *, rosbag2: Annotated[Path, Parameter(help="a new folder")]) -> None:
    """Write a recording as a ROS 2 bag."""
    for topic, number in ros_export.export(Recording(rec), rosbag2).items():
        print(f"{topic}: {number}")


def import_(
    bag: Path,
    *,
    out: Path,
    image: Annotated[str | None, Parameter(help="topic, where the bag has several")] = None,
    scan: str | None = None,
    odometry: str | None = None,
    config: Annotated[str, Parameter(help="whose tracker and camera a replay is to use")] = "hpf",
) -> None:
    """Read a ROS 1 or 2 bag into a recording, for `followerd track`, `replay` and `info`.

    Nobody is enrolled in it: `track --init` says who is to be followed.
    """
    settings = configs.load(config)
    exact = RecordSettings(images="exact", min_free_mb=settings.record.min_free_mb)
    about = {**described(settings), "images": "exact", "imported": str(bag)}
    topics = {"image": image, "scan": scan, "odometry": odometry}
    chosen = {kind: topic for kind, topic in topics.items() if topic is not None}
    tape, numbers, frames = Tape(out, exact, about, 0.0), count(1), 0
    try:
        with Progress(transient=True) as progress:
            bar = progress.add_task("importing", total=None)
            for measurement in ros_import.read(bag, chosen):
                progress.advance(bar)
                if isinstance(measurement, Image):
                    tape.image(measurement)
                    frames += 1
                    looked = Looked(measurement.received, measurement.id, None, None)
                    tape.entry(looked, next(numbers))
                else:
                    tape.entry(Taken(measurement.received, measurement), next(numbers))
    finally:
        tape.close()
    total = next(numbers) - 1
    if not total:
        out.unlink()
        raise UsageError(f"{bag} holds neither images nor scans nor odometry")
    print(f"{out}: {frames} images, {total - frames} scans and base reports")
