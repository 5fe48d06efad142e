"""Finding the line rate of a laser in any state: streaming, idle, booting, or not there at all."""

from collections.abc import Sequence

import structlog

from followerd import clock
from followerd.errors import SetupError
from followerd.hw.lms200.protocol import Acknowledgement, Telegram
from followerd.hw.lms200.session import (
    AFTER_NAK,
    ANSWERED,
    TRIES,
    Rebooted,
    Refused,
    Session,
)
from followerd.hw.lms200.telegrams import POWER_ON_BAUD, Command, Mode, Reply

BOOT_TIME = 65.0  # s, at most, from power to the power-on telegram
QUICK, PATIENT = 0.2, 0.4  # s that an idle laser is given, in turn
LISTENING = 0.8  # s at the rate at which a booted laser announces itself
NOISY_SWEEPS = 3  # sweeps full of noise that prove some other device

log = structlog.get_logger(__name__)


async def find_rate(session: Session, device: str, rates: Sequence[int]) -> None:
    """Stop the laser at the first of `rates` it answers; leaves the session at that rate.

    A silent laser may be booting: it is waited for. Raises SetupError when it stays silent, or
    when what comes is never a telegram; LinkLost.
    """
    begun = clock.now()
    sweeps = noisy_sweeps = 0
    while clock.now() - begun < BOOT_TIME and noisy_sweeps < NOISY_SWEEPS:
        is_noisy = True
        for baud in rates:
            patience = PATIENT if sweeps % 2 else QUICK
            listening = LISTENING if sweeps and baud == POWER_ON_BAUD else 0.0
            heard = session.received_bytes
            if await _answers(session, baud, patience, listening):
                return
            is_noisy &= session.received_bytes > heard
        sweeps += 1
        noisy_sweeps += is_noisy
        if sweeps == 1:
            log.info("laser still booting, waiting", device=device, for_at_most_s=BOOT_TIME)
    if noisy_sweeps == NOISY_SWEEPS:
        raise SetupError(
            device,
            "what comes over the line is no LMS2xx telegram at any rate",
            "check that `link` is the laser's port, and the two wires of each RS-422 pair",
        )
    raise SetupError(
        device,
        f"no answer within {BOOT_TIME:.0f} s at {', '.join(map(str, sorted(rates)))} baud",
        "check its 24 V supply, the cable (bridge 7-8 = RS-422) and `link`",
    )


async def _answers(session: Session, baud: int, patience: float, listening: float) -> bool:
    """Whether the laser answers at `baud` or announces itself; it then streams no longer."""
    try:
        await session.set_baud(baud)
    except SetupError:  # this adapter cannot: the laser cannot be heard at this rate
        return False
    heard = session.received_bytes
    try:
        for _ in range(TRIES):
            session.send(Command.MODE, bytes((Mode.ON_REQUEST,)))
            first = await session.await_one(Reply.MODE, patience, or_mark=True)
            if first is not Acknowledgement.NAK:
                break
            await clock.sleep(AFTER_NAK)
        if first is Acknowledgement.ACK:
            first = await session.await_one(Reply.MODE, ANSWERED[Command.MODE])
        elif first is None:
            # a scan in flight ends before the answer; at a wrong rate this is time lost
            is_talking = session.received_bytes > heard
            wait = session.in_flight + QUICK if is_talking else listening
            first = await session.await_one(Reply.MODE, wait - patience)
    except (Rebooted, Refused):
        return True
    return isinstance(first, Telegram)
