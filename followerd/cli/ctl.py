"""`followerd ctl`: speaks to a running daemon."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from followerd import clock
from followerd.errors import FollowerdError, UsageError
from followerd.runtime.control_socket import ask, default_path

Request = Literal["status", "enrol", "confirm", "arm", "hold", "disarm", "stop", "clear"]


def ctl(
    request: Request,
    region: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    *,
    frame: Annotated[int | None, Parameter(help="id of the picture that was clicked")] = None,
    socket: Annotated[Path | None, Parameter(help="the daemon's control socket")] = None,
) -> None:
    """Ask a running daemon: status, enrol X,Y[,W,H], confirm, arm, hold, disarm, stop, clear.

    `stop` is the emergency stop: it stays until `clear`. A tracker of scans (legs, stream_field)
    enrols who stands at X,Y in m (forward, left), or who was clicked in the picture --frame.
    """
    message: dict[str, object] = {"do": request}
    if request == "enrol":
        message |= {"region": _numbers(region), "frame": frame}
    elif region is not None:
        raise UsageError(f"ctl {request} takes nothing more than its name")
    answer = clock.run(ask(socket or default_path(), message))
    if not answer.pop("ok"):
        raise FollowerdError(f"refused: {answer['error']}")
    for key, value in answer.items():
        print(f"{key}: {_text(value)}")


def _numbers(region: str | None) -> list[float]:
    try:
        numbers = [float(part) for part in (region or "").split(",")]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 4):
        raise UsageError(
            "ctl enrol takes X,Y or X,Y,W,H in pixels, such as 96,70 or 80,40,32,90;"
            " X,Y in m, such as 1.5,0, for a tracker of scans"
        )
    return numbers


def _text(value: object) -> str:
    if isinstance(value, list):
        return "; ".join(str(item) for item in value) or "-"
    if isinstance(value, dict):
        return ", ".join(f"{key} {item}" for key, item in value.items())
    return "-" if value is None else str(value)
