"""Canon's frames are those of its manual, and the decoder survives any line."""

import json
from itertools import pairwise
from math import degrees, radians
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from followerd.hw.p2os.commands import Cmd as P2osCmd
from followerd.hw.p2os.commands import Request as P2osRequest
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.vcc50i import commands
from followerd.hw.vcc50i.commands import Cmd, Status
from followerd.hw.vcc50i.gate import PositionGate
from followerd.hw.vcc50i.head import SLACK
from followerd.hw.vcc50i.protocol import (
    BODY_MAX,
    FROM_CAMERA,
    FROM_HOST,
    NOTE,
    Answer,
    Errors,
    Frame,
    FrameDecoder,
    Request,
    digits,
    number,
    well_formed,
)

# Canon's VC-C50i programmer's manual, and what an independent client sends.
COMMANDS = [
    ("FF 30 30 00 A0 31 EF", commands.POWER_ON),
    ("FF 30 30 00 90 30 EF", commands.HOST_CONTROL),
    ("FF 30 30 00 90 31 EF", commands.REMOTE_CONTROL),
    ("FF 30 30 00 58 30 EF", commands.INITIALISE),
    ("FF 30 30 00 50 33 32 30 EF", commands.pan_speed(800)),
    ("FF 30 30 00 50 30 39 36 EF", commands.pan_speed(150)),
    ("FF 30 30 00 51 32 36 45 EF", commands.tilt_speed(622)),
    ("FF 30 30 00 64 31 37 45 46 35 38 33 30 45 EF", commands.tilt_range(-267, 782)),
    ("FF 30 30 00 62 38 33 32 30 37 45 46 35 EF", commands.move(800, -267)),
    ("FF 30 30 00 62 38 31 30 42 37 46 41 37 EF", commands.move(267, -89)),
    ("FF 30 30 00 63 EF", commands.POSITION),
    ("FF 30 30 00 53 30 EF", commands.STOP),
    ("FF 30 30 00 86 EF", commands.STATUS),
    ("FF 30 30 00 86 30 EF", Request(Cmd.STATUS, b"0")),
    ("FF 30 30 00 B3 30 31 30 30 EF", commands.zoom(256)),
    ("FF 30 30 00 B4 30 EF", commands.ZOOM_POSITION),
    ("FF 30 30 00 57 EF", Request(Cmd.HOME)),
    ("FF 30 30 00 5C 33 EF", Request(Cmd.ANGLE_LIMITS, b"3")),
]
MODE_ERROR = Errors.MODE | Errors.BUSY
ANSWERS = [
    ("FE 30 30 30 30 EF", Answer()),
    ("FE 30 30 31 30 EF", Answer(Errors.BUSY)),
    ("FE 30 30 33 30 EF", Answer(Errors.COMMAND | Errors.BUSY)),
    ("FE 30 30 35 30 EF", Answer(Errors.PARAMETER | Errors.BUSY)),
    ("FE 30 30 39 30 EF", Answer(MODE_ERROR)),
    ("FE 30 30 31 31 EF", Answer(Errors.SYSTEM | Errors.BUSY)),
    ("FE 30 30 30 30 34 38 30 EF", Answer(data=b"480")),
    ("FE 30 30 30 30 33 30 30 31 30 EF", Answer(data=b"30010")),
    ("FE 30 30 30 30 38 33 32 30 37 45 46 35 EF", Answer(data=commands.position_data(800, -267))),
    ("FE 30 30 30 30 43 35 30 69 20 EF", Answer(data=b"C50i ")),
]
DAMAGED = [
    "FE 30 31 30 30 EF",  # another camera's
    "FE 30 30 30 EF",
    "FE 30 30 30 3A EF",
    "FE 30 30 34 31 B0 EF",
    "FE 30 30 30 32 EF",  # an error bit that does not exist
    "FE 30 30 31 30 30 EF",  # an error with data
    "FE 30 30 38 30 EF",  # an error of a camera that is not busy
    "FB 30 30 00 74 30 30 EF",
]
TRANSCRIPT = (
    Path(__file__).parents[2] / "shared/protocols/transcripts/p2os_client_a_pan_tilt_over_aux.jsonl"
)

marks = st.sampled_from([b"\xff", b"\xfe", b"\xef", b"\xfa", b"\xfb", b"\x00", b"00", b"\xfe00"])
noise = st.lists(marks | st.binary(max_size=4), max_size=40).map(b"".join)
texts = st.text("0123456789ABCDEF", max_size=12).map(str.encode)
answers = st.builds(Answer, data=texts) | st.sampled_from([a for _, a in ANSWERS])


def client_requests() -> list[Request]:
    """What an independent client told a camera through the base's AUX port."""
    sent = []
    for line in TRANSCRIPT.read_text().splitlines():
        for packet in PacketDecoder().feed(bytes.fromhex(json.loads(line)["hex"])):
            told = P2osRequest.parse(packet.payload)
            if told.number == P2osCmd.TTY2:
                (frame,) = FrameDecoder(FROM_HOST).feed(told.string)
                sent.append(Request.parse(frame))
    return [request for request in sent if request is not None]


def answers_in(data: bytes) -> list[Answer]:
    """What the driver takes from `data`."""
    return [a for frame in FrameDecoder().feed(data) if (a := Answer.parse(frame)) is not None]


@pytest.mark.parametrize(("wire", "request_"), COMMANDS, ids=[w for w, _ in COMMANDS])
def test_commands_are_those_on_the_wire(wire: str, request_: Request) -> None:
    assert request_.to_bytes() == bytes.fromhex(wire)
    (frame,) = FrameDecoder(FROM_HOST).feed(bytes.fromhex(wire))
    assert Request.parse(frame) == request_


@pytest.mark.parametrize(("wire", "answer"), ANSWERS, ids=[w for w, _ in ANSWERS])
def test_answers_are_those_on_the_wire(wire: str, answer: Answer) -> None:
    assert answer.to_bytes() == bytes.fromhex(wire)
    assert answers_in(bytes.fromhex(wire)) == [answer]


@pytest.mark.parametrize("wire", DAMAGED)
def test_what_is_no_answer_of_this_camera_is_not_taken_for_one(wire: str) -> None:
    assert answers_in(bytes.fromhex(wire)) == []


def test_a_note_of_an_ended_command_is_no_answer() -> None:
    (frame,) = FrameDecoder().feed(bytes.fromhex("FA 30 30 00 62 38 33 32 30 37 45 46 35 EF"))
    assert frame.header == NOTE
    assert Answer.parse(frame) is None
    assert Request.parse(frame) is None


def test_another_cameras_command_is_not_obeyed() -> None:
    (frame,) = FrameDecoder(FROM_HOST).feed(bytes.fromhex("FF 30 31 00 58 30 EF"))
    assert Request.parse(frame) is None


def test_every_frame_that_an_independent_client_sends_parses() -> None:
    if not TRANSCRIPT.exists():
        pytest.skip(f"needs {TRANSCRIPT.name}, captured from an independent client")
    sent = client_requests()
    assert [request.command for request in sent] == [
        *(Cmd.POWER, Cmd.CONTROL, Cmd.INITIALISE, Cmd.PAN_SPEED, Cmd.TILT_SPEED, Cmd.RANGE),
        *(Cmd.INITIALISE, Cmd.MOVE, Cmd.ZOOM, Cmd.FOCUS),
        *(Cmd.POSITION, Cmd.ZOOM_POSITION, Cmd.POSITION, Cmd.ZOOM_POSITION),
    ]
    assert sent[7] == commands.move(267, -89)


@given(answers, st.lists(st.integers(0, 30)))
def test_an_answer_split_anywhere_decodes_the_same(answer: Answer, cuts: list[int]) -> None:
    wire = b"\x00" + answer.to_bytes() + b"\xfe0"
    whole = FrameDecoder().feed(wire)
    decoder, parts = FrameDecoder(), []
    places = sorted({0, len(wire), *(min(cut, len(wire)) for cut in cuts)})
    for start, end in pairwise(places):
        parts += decoder.feed(wire[start:end])
    assert parts == whole
    assert [frame.offset for frame in parts] == [1]
    assert [Answer.parse(frame) for frame in parts] == [answer]


@given(noise, answers)
def test_an_answer_after_any_noise_arrives(before: bytes, answer: Answer) -> None:
    assert answers_in(before + answer.to_bytes())[-1] == answer


@given(noise)
def test_noise_raises_nothing_and_is_not_kept(data: bytes) -> None:
    decoder = FrameDecoder()
    frames = decoder.feed(data)
    assert decoder.stats.frames == len(frames)
    counted = decoder.stats.noise_bytes + sum(len(frame.to_bytes()) for frame in frames)
    assert 0 <= len(data) - counted <= BODY_MAX + 1  # the rest may still become a frame


@given(st.integers(0, 15), st.binary(min_size=4, max_size=BODY_MAX))
def test_a_frame_is_found_where_it_stands(lead: int, body: bytes) -> None:
    if not set(body) & set(b"\xef\xfa\xfb\xfe\xff"):
        frame = Frame(FROM_CAMERA[0], body)
        (found,) = FrameDecoder().feed(bytes(lead) + frame.to_bytes())
        assert (found, found.offset) == (frame, lead)


@given(st.integers(-0x8000, 0x7FFF), st.integers(-0x8000, 0x7FFF))
def test_positions_come_back_as_sent(pan: int, tilt: int) -> None:
    assert commands.position_of(commands.position_data(pan, tilt)) == (pan, tilt)


@pytest.mark.parametrize(
    "data", [b"", b"83207EF", b"83207EF55", b"83207ef5", b"8320 7EF", b"+8320000"]
)
def test_a_damaged_position_is_none(data: bytes) -> None:
    assert commands.position_of(data) is None


def test_pan_is_positive_to_the_left_and_tilt_upward() -> None:
    assert commands.move(commands.pan_steps(radians(-90)), commands.tilt_steps(radians(-30))) == (
        Request(Cmd.MOVE, b"83207EF5")  # the manual: pan right 90 degrees, tilt lower 30 degrees
    )
    assert degrees(commands.pan_angle(800)) == pytest.approx(-90)
    assert degrees(commands.tilt_angle(-267)) == pytest.approx(-30.04, abs=0.01)


@given(st.floats(-1.7, 1.7))
def test_angles_come_back_to_half_a_step(angle: float) -> None:
    half = commands.STEP / 2 + 1e-9
    assert commands.pan_angle(commands.pan_steps(angle)) == pytest.approx(angle, abs=half)
    assert commands.tilt_angle(commands.tilt_steps(angle)) == pytest.approx(angle, abs=half)


def test_zoom_runs_from_wide_to_tele() -> None:
    assert [commands.zoom_position(f) for f in (0.1, 1, 26, 100)] == [0, 0, 1960, 1960]
    assert commands.zoom_factor(1960) == pytest.approx(26)
    assert commands.zoom_factor(commands.zoom_position(7)) == pytest.approx(7, rel=0.002)


def test_the_status_bits_are_the_manuals() -> None:
    assert Status(number(b"480") or 0) == Status.TILT_LIMIT | Status.ZOOMING
    assert Status(number(b"30010") or 0) & Status.NOT_INITIALISED


def test_a_number_that_does_not_fit_is_not_sent() -> None:
    for value in (-1, 0x1000):
        with pytest.raises(ValueError, match="does not fit"):
            digits(value, 3)


def test_a_lying_camera_still_speaks_in_frames() -> None:
    """For the twins' fault `wrong`."""
    for wire in (b"\xfe0000\xfd7\x00\xff21AB\xef", b"garbage!"):
        (frame,) = FrameDecoder().feed(well_formed(wire))
        assert Answer.parse(frame) is not None
    assert well_formed(b"\xfe0") == b"\xfe0"


class Damaged(NamedTuple):
    """What came of damaged answers to POSITION."""

    taken: int  # as positions
    wrong: int  # of them
    leaps: int  # of those, more than a degree off and yet believed of a resting head


def fuzz(seed: int, count: int) -> Damaged:
    """Every answer of a resting head hurt in one of five ways."""
    rng = np.random.default_rng([seed, 4])
    decoder, taken, wrong, leaps = FrameDecoder(), 0, 0, 0
    gate = PositionGate(((-889, 889), (-267, 800)), (800, 622), SLACK)
    draws = rng.integers(0, [5, 14, 8], (count, 3)).tolist()
    noise = rng.bytes(count + 16)
    true, whole = (123, -45), Answer(data=commands.position_data(123, -45)).to_bytes()
    for first, (kind, place, extra) in enumerate(draws):
        wire = bytearray(whole)
        if kind == 0:
            wire[place] ^= 1 << extra
        elif kind == 1:
            del wire[place : place + 1 + extra // 2]
        elif kind == 2:
            wire[place:place] = noise[first : first + 1 + extra]
        elif kind == 3:
            wire += wire[:place]
        else:
            wire[:] = noise[first : first + 14]
        for frame in decoder.feed(bytes(wire)):
            answer = Answer.parse(frame)
            position = None if answer is None else commands.position_of(answer.data)
            if position is not None:
                taken += 1
                wrong += position != true
                passes = gate.passes(position, 0.05 * first, [true])
                off = max(abs(position[0] - true[0]), abs(position[1] - true[1]))
                leaps += passes and off > SLACK
        assert len(decoder._buffer) <= BODY_MAX + 1
    return Damaged(taken, wrong, leaps)


def test_damage_is_not_taken_for_another_position() -> None:
    damaged = fuzz(0, 3000)
    assert damaged.taken > 500  # those damaged beside the frame
    assert damaged.wrong < 0.08 * 3000  # from digit to digit: nothing in the frame can tell
    assert damaged.leaps == 0  # but the head cannot have been there


@pytest.mark.slow
def test_a_million_damaged_answers_neither_raise_nor_fill_the_memory() -> None:
    damaged = fuzz(1, 1_000_000)
    assert damaged.taken > 100_000
    assert damaged.leaps < 1_000_000 / 2**15
