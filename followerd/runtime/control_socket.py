"""The unix socket through which `followerd ctl` speaks to a running daemon: one JSON object a line.

Request `{"do": "arm"}` or `{"do": "enrol", "region": [x, y, w, h], "frame": 12}`; answer
`{"ok": true, ...}` or `{"ok": false, "error": "..."}`. The socket is readable by its owner only.
"""

import asyncio
import json
import os
from collections.abc import Awaitable, Callable
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np

from followerd import clock
from followerd.control.transitions import Action
from followerd.errors import DeviceError, FollowerdError, UsageError
from followerd.messages import Box, RobotPose
from followerd.runtime.daemon import Daemon

LONGEST_REQUEST = 4096  # bytes
ACTIONS = {
    "confirm": Action.CONFIRM,
    "arm": Action.ARM,
    "hold": Action.HOLD,
    "disarm": Action.DISARM,
    "stop": Action.STOP,
    "clear": Action.CLEAR,
}
Reply = Callable[[bytes], Awaitable[dict[str, Any]]]  # one line in, one JSON object out
REQUESTS = ("status", "enrol", *ACTIONS)


def default_path() -> Path:
    """`followerd.sock` in the service's, else the user's runtime directory."""
    folder = os.environ.get("RUNTIME_DIRECTORY") or os.environ.get("XDG_RUNTIME_DIR")
    return Path(folder or f"/tmp/followerd-{os.getuid()}") / "followerd.sock"


async def serve(daemon: Daemon, path: Path) -> None:
    """Answer requests until cancelled. Raises DeviceError when another daemon holds the socket."""
    await listen(path, lambda line: answer(daemon, line))


async def listen(path: Path, reply: Reply) -> None:
    """Give each line that comes to the socket `path` its answer; raises DeviceError as `serve`."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    if path.exists():
        if not path.is_socket():
            raise DeviceError("control socket", f"{path} is in the way", "remove or rename it")
        if await _alive(path):
            raise DeviceError(
                "control socket", f"{path} belongs to a running daemon", "stop that one first"
            )
        path.unlink()
    old_mask = os.umask(0o177)
    try:
        server = await asyncio.start_unix_server(
            lambda reader, writer: _converse(reply, reader, writer), path, limit=LONGEST_REQUEST
        )
    except OSError as error:
        raise DeviceError("control socket", f"{path}: {error}", "choose another place") from error
    finally:
        os.umask(old_mask)
    try:
        async with server:
            await server.serve_forever()
    finally:
        path.unlink(missing_ok=True)


async def ask(
    path: Path, request: dict[str, Any], who: str = "daemon", command: str = "followerd run"
) -> dict[str, Any]:
    """Send one request and return the answer; raises DeviceError when nobody listens."""
    try:
        reader, writer = await asyncio.open_unix_connection(path)
    except OSError as error:
        raise DeviceError(
            who, f"nobody listens at {path} ({error.strerror})", f"is `{command}` running?"
        ) from None
    writer.write(json.dumps(request).encode() + b"\n")
    line = await clock.within(5.0, reader.readline())
    writer.close()
    if not line:
        raise DeviceError(who, f"no answer at {path}", "restart it")
    answer: dict[str, Any] = json.loads(line)
    return answer


async def answer(daemon: Daemon, line: bytes) -> dict[str, Any]:
    """What one request line gets; a malformed one changes nothing."""
    try:
        request = json.loads(line)
        do = request["do"]
    except (ValueError, TypeError, KeyError):
        return _refused('a request is one JSON object a line, such as {"do": "status"}')
    if do == "status":
        return {"ok": True, **status(daemon)}
    if do == "enrol":
        try:
            region, frame = _region(request.get("region")), _frame(request.get("frame"))
            state = await daemon.enrol(region, frame)
        except FollowerdError as error:
            return _refused(str(error))
        box, place = _numbers(state.box), _pair(state.position)
        confidence = round(state.confidence, 3)
        return {"ok": True, "box": box, "position_m": place, "confidence": confidence}
    if do not in ACTIONS:
        return _refused(f"unknown request {do!r}; known are {', '.join(REQUESTS)}")
    refused = daemon.act(ACTIONS[do])
    return _refused(refused) if refused else {"ok": True, **status(daemon)}


def status(daemon: Daemon) -> dict[str, Any]:
    """Mode, reasons, person and device figures as JSON values."""
    decision = daemon.decision
    if decision is None:
        return {"mode": "disarmed", "reasons": ["starting"]}
    track = decision.track
    return {
        "mode": decision.mode.value,
        "reasons": [str(reason) for reason in decision.reasons],
        "frames": daemon.stats.frames,
        "scans": daemon.stats.scans,
        "newest_frame": daemon.vision.newest.id if daemon.vision.newest else None,
        "person": None
        if track is None
        else {
            "phase": track.phase.value,
            "confidence": round(track.confidence, 3),
            "box": _numbers(track.box),
            "range_m": None if track.range is None else round(track.range, 3),
            "bearing_rad": None if track.bearing is None else round(track.bearing, 4),
        },
        **({} if daemon.pipeline.localizer is None else {"pose": _pose(decision.pose)}),
    }


async def _alive(path: Path) -> bool:
    try:
        _, writer = await asyncio.open_unix_connection(path)
    except OSError:
        return False
    writer.close()
    return True


async def _converse(
    reply: Reply, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    try:
        while line := await reader.readline():
            writer.write(json.dumps(await reply(line)).encode() + b"\n")
            await writer.drain()
    except (ValueError, ConnectionError):  # a line longer than the limit, or a caller gone
        pass
    finally:
        writer.close()


def _region(value: object) -> Box | tuple[float, float]:
    numbers = (
        [float(n) for n in value]
        if isinstance(value, list) and all(isinstance(n, int | float) for n in value)
        else []
    )
    if len(numbers) == 2:
        return numbers[0], numbers[1]
    if len(numbers) == 4:
        return Box(*numbers)
    raise UsageError("region is [x, y] or [x, y, width, height]")


def _frame(value: object) -> int | None:
    if value is None or isinstance(value, int):
        return value
    raise UsageError("frame is a whole number: the id of the picture that was clicked")


def _numbers(box: Box | None) -> list[float] | None:
    return None if box is None else [round(v, 1) for v in (box.x, box.y, box.w, box.h)]


def _pair(point: tuple[float, float] | None) -> list[float] | None:
    return None if point is None else [round(v, 3) for v in point]


def _pose(pose: RobotPose | None) -> dict[str, Any]:
    """Where the robot is on the map."""
    if pose is None or pose.lost:
        return {"lost": True}
    at = pose.map_from_base
    return {
        "x_m": round(at.x, 3),
        "y_m": round(at.y, 3),
        "yaw_deg": round(degrees(at.theta), 1),
        "sigma_m": round(float(np.sqrt(max(pose.covariance[0, 0], pose.covariance[1, 1]))), 3),
    }


def _refused(error: str) -> dict[str, Any]:
    return {"ok": False, "error": error}
