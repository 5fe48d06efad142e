"""The operating modes of the LMS200 twin: what they take, and what they send."""

from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import PASSWORD, Mode, Reply
from followerd.hw.lms200.variant import Variant

STREAMING = (
    Mode.STREAM,
    Mode.STREAM_MEAN,
    Mode.STREAM_SUBRANGE,
    Mode.STREAM_MEAN_SUBRANGE,
    Mode.STREAM_PARTIAL,
)
PARAMETER_BYTES = {
    Mode.INSTALLATION: len(PASSWORD),
    Mode.STREAM: 0,
    Mode.ON_REQUEST: 0,
    Mode.STREAM_MEAN: 1,
    Mode.STREAM_SUBRANGE: 4,
    Mode.STREAM_MEAN_SUBRANGE: 5,
    Mode.STREAM_PARTIAL: 0,
}


def mode_of(code: bytes, parameters: bytes, variant: Variant) -> Mode | None:
    """The mode that is asked for; None when it does not exist or its parameters are wrong."""
    if not code or code[0] not in PARAMETER_BYTES:
        return None
    mode = Mode(code[0])
    return mode if _accepts(mode, parameters, variant) else None


def sweep_of(mode: Mode, parameters: bytes, variant: Variant, number: int) -> Sweep:
    """What telegram `number` of the mode's stream holds; a whole scan if it does not stream."""
    match mode:
        case Mode.STREAM_PARTIAL:
            return Sweep(variant, turn=number % variant.rotations)
        case Mode.STREAM_MEAN:
            return Sweep(variant, Reply.MEAN, samples=parameters[0])
        case Mode.STREAM_SUBRANGE:
            first, last = _subrange(parameters)
            return Sweep(variant, Reply.SUBRANGE, first=first, last=last)
        case Mode.STREAM_MEAN_SUBRANGE:
            first, last = _subrange(parameters[1:])
            return Sweep(
                variant, Reply.MEAN_SUBRANGE, samples=parameters[0], first=first, last=last
            )
        case _:
            return Sweep(variant)


def _accepts(mode: Mode, parameters: bytes, variant: Variant) -> bool:
    if len(parameters) != PARAMETER_BYTES[mode]:
        return False
    match mode:
        case Mode.INSTALLATION:
            return parameters == PASSWORD
        case Mode.STREAM_MEAN:
            return parameters > b"\1"
        case Mode.STREAM_SUBRANGE:
            return _is_within(variant, *_subrange(parameters))
        case Mode.STREAM_MEAN_SUBRANGE:
            return parameters[0] > 1 and _is_within(variant, *_subrange(parameters[1:]))
        case _:
            return True


def _is_within(variant: Variant, first: int, last: int) -> bool:
    return 1 <= first <= last <= variant.count


def _subrange(parameters: bytes) -> tuple[int, int]:
    """First and last number of a sub-range's values, from 1."""
    return int.from_bytes(parameters[:2], "little"), int.from_bytes(parameters[2:4], "little")
