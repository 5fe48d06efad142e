"""`followerd info`, `plot` and `recover`: what was recorded."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from followerd.bench.recorded_plots import plots
from followerd.bench.report import page
from followerd.cli.run import in_a_folder
from followerd.errors import UsageError
from followerd.record import recovery
from followerd.record.digest import Digest, digest
from followerd.record.reading import Recording


def info(rec: Path) -> None:
    """Say what a recording holds."""
    recording = Recording(rec)
    for line in _lines(recording, digest(recording)):
        print(line)


def plot(
    rec: Path,
    *,
    out: Annotated[
        Path | None,
        Parameter(help="*.png or *.html; default: beside the recording", validator=in_a_folder),
    ] = None,
) -> None:
    """Draw range, bearing, speeds, confidence, modes and the ways of robot and person."""
    recording = Recording(rec)
    found = digest(recording)
    if not found.stamps:
        raise UsageError(f"{rec} holds no decisions to draw")
    path = out or rec.with_suffix(".png")
    drawn = plots(found)
    try:
        if path.suffix == ".html":
            lines = "\n".join(_lines(recording, found))
            path.write_text(page(rec.name, lines, drawn), encoding="utf-8")
        elif path.suffix == ".png":
            drawn["Run"].savefig(path, dpi=110, bbox_inches="tight")
        else:
            raise UsageError(f"--out {path}: name it *.png or *.html")
    except OSError as error:
        raise UsageError(f"--out {path}: cannot be written: {error.strerror}") from None
    print(path)


def recover(
    rec: Path,
    *,
    out: Annotated[Path | None, Parameter(help="default: NAME-recovered.mcap")] = None,
) -> None:
    """Make a whole file of a recording that was cut off; the old one stays as it is."""
    path = out or rec.with_name(f"{rec.stem}-recovered{rec.suffix}")
    count, broken = recovery.recover(rec, path)
    print(
        f"{path}: {count} messages; " + (f"cut off: {broken}" if broken else "nothing was missing")
    )


def _lines(recording: Recording, found: Digest) -> list[str]:
    about = recording.about
    size = sum(part.stat().st_size for part in recording.parts) / 1e6
    lines = [
        f"files: {', '.join(map(str, recording.parts))} ({size:.1f} MB)",
        f"duration: {found.duration:.1f} s",
        f"images: {about['images']}",
        "written by: " + ", ".join(
            f"{name} {about[name]}" for name in about if name not in ("config", "images", "part")
        ),
    ]  # fmt: skip
    lines += [f"{name}: {count}" for name, count in sorted(found.counts.items())]
    lines += [f"{mode}: {seconds} s" for mode, seconds in found.mode_times().items()]
    began = found.stamps[0] if found.stamps else 0.0
    lines += [f"at {at - began:.2f} s: {text or 'free to move'}" for at, text in found.stops]
    if recording.truncated:
        lines.append(f"cut off: {recording.truncated}; `followerd recover` makes it whole")
    return lines
