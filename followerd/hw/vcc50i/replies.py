"""How long the camera's answers are, for who has to ask for them by length (a base's AUX port)."""

from followerd.hw.vcc50i.commands import POSITION_DIGITS, STATUS_DIGITS, ZOOM_DIGITS, Cmd

SHORTEST = 6  # bytes of an answer without data, an error's too
AT_COMMAND = 4  # where a request's frame says what it is

DIGITS: dict[int, int] = {
    Cmd.STATUS: STATUS_DIGITS,
    Cmd.POSITION: POSITION_DIGITS,
    Cmd.ZOOM_POSITION: ZOOM_DIGITS,
    Cmd.ANGLE_LIMITS: 4,
    Cmd.SPEED_LIMITS: 3,
    Cmd.SPEED: 3,
    Cmd.ZOOM_RATIO: 2,
    Cmd.NAME: 5,
}


def rest_of_answer(request: bytes) -> int:
    """Bytes of the answer to a request's frame beyond the shortest one."""
    return DIGITS.get(request[AT_COMMAND], 0) if len(request) > AT_COMMAND else 0
