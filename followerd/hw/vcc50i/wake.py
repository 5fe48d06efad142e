"""From any state to one in which the camera obeys: control, power, limits, speeds, home position.

Only `find_home` moves the head.
"""

from collections.abc import Callable
from math import radians

import structlog

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.vcc50i.commands import (
    HOST_CONTROL,
    INITIALISE,
    KNOWN_STATUS,
    ORIGIN,
    POWER_ON,
    STATUS,
    STATUS_DIGITS,
    STEP,
    TURNING,
    Cmd,
    Status,
    pan_speed,
    tilt_range,
    tilt_speed,
)
from followerd.hw.vcc50i.models import MODELS, SLOWEST, Limits
from followerd.hw.vcc50i.protocol import Request, number
from followerd.hw.vcc50i.session import Busy, Refused, Session, WrongMode
from followerd.hw.vcc50i.settings import Vcc50iSettings

POWERS_UP = 10.0  # s; it takes some 4.5
FINDS_HOME = 20.0  # s; it takes some 5
FREE = 10.0  # s to end what it was at
AGAIN = 0.2  # s between questions while it is busy
FARTHEST, FASTEST = 1600, 1000  # steps, steps/s; what exceeds them was damaged under way

log = structlog.get_logger()


async def status_of(session: Session) -> Status:
    """The operation status; a camera answers this in any mode."""
    value = number(await session.ask(STATUS, STATUS_DIGITS)) or 0
    return Status(value & KNOWN_STATUS)


async def wake(session: Session, device: str) -> None:
    """Take control and switch the camera on; raises SetupError with the remedy."""
    try:
        await when_free(session, HOST_CONTROL)
        if Status.CAMERA_OFF & await status_of(session):
            await when_free(session, POWER_ON)
    except Refused as reason:
        raise SetupError(
            device, f"the camera gives no control: {reason}", "close its menu"
        ) from reason
    if not await _until(session, lambda status: not status & Status.CAMERA_OFF, POWERS_UP):
        raise SetupError(device, "the camera does not switch on", "switch it on by hand")


async def limits_of(session: Session, settings: Vcc50iSettings) -> Limits:
    """What the camera says of its travel and speeds; its model's figures where it does not."""
    known = MODELS[settings.model]

    async def asked(command: Cmd, which: bytes, count: int, least: int, most: int) -> int | None:
        try:
            data = await session.ask(Request(command, which), None)
        except WrongMode:
            raise
        except Refused:
            return None
        value = number(data) if len(data) == count else None
        return value if value is not None and least <= value <= most else None

    async def angles(low: bytes, high: bytes, otherwise: tuple[int, int]) -> tuple[int, int]:
        lowest = await asked(Cmd.ANGLE_LIMITS, low, 4, ORIGIN - FARTHEST, ORIGIN - 1)
        highest = await asked(Cmd.ANGLE_LIMITS, high, 4, ORIGIN + 1, ORIGIN + FARTHEST)
        if lowest is None or highest is None:
            return otherwise
        return lowest - ORIGIN, highest - ORIGIN

    return Limits(
        pan=await angles(b"0", b"1", known.pan),
        tilt=await angles(b"2", b"3", known.tilt),
        pan_speed=await asked(Cmd.SPEED_LIMITS, b"1", 3, SLOWEST, FASTEST) or known.pan_speed,
        tilt_speed=await asked(Cmd.SPEED_LIMITS, b"3", 3, SLOWEST, FASTEST) or known.tilt_speed,
        zoom_tele=await asked(Cmd.ZOOM_POSITION, b"3", 4, 100, 10000) or known.zoom_tele,
        zoom_ratio=await asked(Cmd.ZOOM_RATIO, b"", 2, 2, 100) or known.zoom_ratio,
    )


async def name_of(session: Session) -> str:
    """How the camera calls itself, if it does."""
    try:
        return (await session.ask(Request(Cmd.NAME), None)).decode("ascii").strip()
    except Refused:
        return "unnamed"


async def configure(
    session: Session, settings: Vcc50iSettings, limits: Limits, device: str
) -> tuple[int, int]:
    """Set speeds and the whole range of tilt; the speeds (pan, tilt) in steps/s."""
    pan = _speed(settings.pan_speed_dps, limits.pan_speed)
    tilt = _speed(settings.tilt_speed_dps, limits.tilt_speed)
    for request in (pan_speed(pan), tilt_speed(tilt), tilt_range(*limits.tilt)):
        try:
            await when_free(session, request)
        except WrongMode:
            raise
        except Refused as reason:
            raise SetupError(
                device, f"the camera does not take its settings: {reason}", "is `model` right?"
            ) from reason
    return pan, tilt


async def find_home(session: Session, device: str) -> None:
    """Let the head find its home position: it turns, for some 5 s."""
    log.info("head finds its home position", device=device)
    await when_free(session, INITIALISE)
    if not await _until(session, is_still, FINDS_HOME):
        raise SetupError(
            device, "the head does not find its home position", "see that it can turn freely"
        )


def is_still(status: Status) -> bool:
    """Whether the head knows where it is, and rests."""
    return not status & (TURNING | Status.NOT_INITIALISED)


async def when_free(session: Session, request: Request) -> None:
    """Tell the camera as soon as it is free; raises Busy when it is not for long."""
    patience = clock.now() + FREE
    while True:
        try:
            return await session.tell(request)
        except Busy:
            if clock.now() >= patience:
                raise
            await clock.sleep(AGAIN)


async def _until(session: Session, is_so: Callable[[Status], bool], seconds: float) -> bool:
    patience = clock.now() + seconds
    while not is_so(await status_of(session)):
        if clock.now() >= patience:
            return False
        await clock.sleep(AGAIN)
    return True


def _speed(dps: float, fastest: int) -> int:
    return min(max(round(radians(dps) / STEP), SLOWEST), fastest)
