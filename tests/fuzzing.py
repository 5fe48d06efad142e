"""Coverage-guided fuzzing, as small as it goes: inputs that reach new code breed further ones.

Deterministic: one generator, a count of runs instead of a time. An edge is two lines executed one
after the other in one call; only the modules under test are looked at.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import FrameType, ModuleType
from typing import Any

import numpy as np

LONGEST = 900  # bytes of an input
RECENT = 16  # newest finds, which every other input is bred from

Target = Callable[[bytes], object]
Mend = Callable[[bytes], bytes]
Edge = tuple[str, int, int]


@dataclass(frozen=True, slots=True)
class Found:
    """What fuzzing reached."""

    runs: int
    edges: int
    at_first: int  # edges that the seeds alone reach
    corpus: list[bytes]


def fuzz(
    target: Target,
    modules: Sequence[ModuleType],
    seeds: Sequence[bytes],
    runs: int,
    rng: np.random.Generator,
    mend: Mend = bytes,
) -> Found:
    """Call `target` with `runs` inputs; what it raises comes through, with the input as a note."""
    files = {module.__file__ or "" for module in modules}
    corpus = list(seeds)
    seen = {edge for seed in seeds for edge in edges(target, seed, files)}
    at_first = len(seen)
    for n in range(runs):
        pool = corpus[-RECENT:] if n % 2 else corpus
        data = mutated(pool[int(rng.integers(len(pool)))], corpus, rng)
        if rng.random() < 0.7:
            data = mend(data)
        fresh = edges(target, data, files) - seen
        if fresh:
            seen |= fresh
            corpus.append(data)
    return Found(runs, len(seen), at_first, corpus)


def edges(target: Target, data: bytes, files: set[str]) -> set[Edge]:
    """What `target` executes of `files` for an input."""
    met: set[Edge] = set()
    last: dict[int, int] = {}  # line by frame

    def enter(frame: FrameType, event: str, argument: Any) -> Any:
        name = frame.f_code.co_filename
        if name not in files:
            return None
        here = id(frame)
        last[here] = 0

        def step(frame: FrameType, event: str, argument: Any) -> Any:
            if event == "line":
                met.add((name, last[here], frame.f_lineno))
                last[here] = frame.f_lineno
            return step

        return step

    before = sys.gettrace()
    sys.settrace(enter)
    try:
        target(data)
    except BaseException as error:
        error.add_note(f"input: {data.hex()}")
        raise
    finally:
        sys.settrace(before)
    return met


def mutated(parent: bytes, corpus: Sequence[bytes], rng: np.random.Generator) -> bytes:
    """The parent with one to four changes."""
    data = bytearray(parent)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(len(data) + 1))
        count = int(rng.integers(1, 9))
        match int(rng.integers(7)):
            case 0 if data:
                data[at % len(data)] ^= 1 << int(rng.integers(8))
            case 1 if data:
                data[at % len(data)] = (0, 1, 2, 0x7F, 0x80, 0xFA, 0xFB, 0xFF)[count % 8]
            case 2 if data:
                data[at % len(data)] = (data[at % len(data)] + int(rng.integers(-4, 5))) % 256
            case 3:
                data[at : at + count] = rng.bytes(count)
            case 4:
                del data[at : at + count]
            case 5:
                data[at:at] = rng.bytes(count)
            case _:
                other = corpus[int(rng.integers(len(corpus)))]
                data[at:] = other[int(rng.integers(len(other) + 1)) :]
    return bytes(data[:LONGEST])
