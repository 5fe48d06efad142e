"""The truth as JSON lines: how a simulation in another process tells the scorer what really was."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from followerd.geometry import Pose2
from followerd.messages import Twist
from followerd.sim.truth import Actor, Truth


def to_line(truth: Truth) -> str:
    """One line of JSON."""
    return json.dumps(asdict(truth), separators=(",", ":"))


def from_line(line: str) -> Truth:
    """The inverse of `to_line`."""
    values: dict[str, Any] = json.loads(line)
    return Truth(
        **values
        | {
            "pose": Pose2(**values["pose"]),
            "twist": Twist(**values["twist"]),
            "target": _actor(values["target"]),
            "others": tuple(_actor(other) for other in values["others"]),
        }
    )


def read(path: Path) -> list[Truth]:
    """All complete lines of a log; the last one may have been cut off."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return [from_line(line) for line in lines]


class Tail:
    """The newest truth of a log that another process still writes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read = 0
        self._newest: Truth | None = None

    def newest(self) -> Truth | None:
        """The last complete line; None as long as there is none."""
        if self._path.exists():
            with self._path.open("rb") as file:
                file.seek(self._read)
                *lines, rest = file.read().split(b"\n")
                self._read = file.tell() - len(rest)
            if lines:
                self._newest = from_line(lines[-1].decode())
        return self._newest


def _actor(values: dict[str, Any]) -> Actor:
    return Actor(**values | {"velocity": tuple(values["velocity"])})
