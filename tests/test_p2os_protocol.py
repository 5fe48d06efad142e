"""P2OS packets are those of the manuals, and the decoder survives any line."""

from dataclasses import replace
from math import cos, radians, sin
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from followerd.hw.p2os.commands import (
    FORBIDDEN,
    Cmd,
    Request,
    command,
    join_bytes,
    split_bytes,
)
from followerd.hw.p2os.config import Config, Identity, is_config_with_wrong_checksum
from followerd.hw.p2os.models import MODELS, find
from followerd.hw.p2os.packets import (
    Battery,
    Encoders,
    GripperState,
    Gyro,
    Io,
    Joystick,
    ResetNote,
    SerAux,
    Value,
    parse,
)
from followerd.hw.p2os.protocol import (
    PAYLOAD_MAX,
    Packet,
    PacketDecoder,
    checksum,
    frame,
    with_checksum,
)
from followerd.hw.p2os.sip import MOVING, Flags, Sip, Tail

# Vectors from outside the project: manuals, and captures of independent clients.
CAMERA_ON = bytes.fromhex("FF 30 30 00 A0 31 EF")
COMMANDS = [
    ("FA FB 03 00 00 00", Request(Cmd.PULSE)),
    ("FA FB 03 01 00 01", Request(Cmd.OPEN)),
    ("FA FB 03 02 00 02", Request(Cmd.CLOSE)),
    ("FA FB 06 01 3B 01 00 02 3B", Request(Cmd.OPEN, 1)),
    ("FA FB 06 02 3B 01 00 03 3B", Request(Cmd.CLOSE, 1)),
    ("FA FB 06 04 3B 01 00 05 3B", Request(Cmd.ENABLE, 1)),
    ("FA FB 06 0B 1B 96 00 A1 1B", Request(Cmd.VEL, -150)),
    ("FA FB 06 0B 3B C8 00 D3 3B", Request(Cmd.VEL, 200)),
    ("FA FB 06 15 1B 14 00 29 1B", Request(Cmd.RVEL, -20)),
    ("FA FB 06 0C 3B 5A 00 66 3B", Request(Cmd.HEAD, 90)),
    ("FA FB 06 0D 1B 2D 00 3A 1B", Request(Cmd.DHEAD, -45)),
    ("FA FB 06 06 3B EE 02 F4 3D", Request(Cmd.SETV, 750)),
    ("FA FB 06 05 1B 2C 01 31 1C", Request(Cmd.SETA, -300)),
    ("FA FB 03 07 00 07", Request(Cmd.SETO)),
    ("FA FB 03 1D 00 1D", Request(Cmd.STOP)),
    ("FA FB 03 37 00 37", Request(Cmd.E_STOP)),
    ("FA FB 06 1C 3B 00 00 1C 3B", Request(Cmd.SONAR, 0)),
    ("FA FB 06 12 3B 01 00 13 3B", Request(Cmd.CONFIG, 1)),
    ("FA FB 06 2B 3B 06 00 31 3B", Request(Cmd.GETAUX, 6)),
    ("FA FB 06 32 3B 02 00 34 3B", Request(Cmd.HOSTBAUD, 2)),
    ("FA FB 06 20 3B FB 0A 1B 45", Request(Cmd.VEL2, join_bytes(10, -5))),
    ("FA FB 06 20 1B F6 04 16 1F", Request(Cmd.VEL2, join_bytes(-5, 10))),
    (
        "FA FB 09 0F 2B 04 0A 3C 0A 40 4F 7F",
        Request(Cmd.SAY, bytes([10, 60, 10, 64])),
    ),
    ("FA FB 0C 2A 2B 07 FF 30 30 00 A0 31 EF 94 E9", Request(Cmd.TTY2, CAMERA_ON)),
]
MOVING_SIP = Sip(
    type=MOVING,
    x_raw=1234,
    y_raw=0x7FC8,
    heading_raw=1024,
    left=150,
    right=250,
    battery=124,
    flags=Flags.MOTORS | Flags.SONAR_1 | Flags.SONAR_2,
    sonar=((0, 1500), (3, 5000)),
    digital_in=0xFF,
)
REPORTS: list[tuple[str, Value]] = [
    ("FA FB 0B 90 E8 03 00 00 FE FF FF FF 94 1A", Encoders(1000, -2)),
    (
        "FA FB 21 33 D2 04 C8 7F 00 04 96 00 FA 00 7C 00 00 00 00 07 00 00 02"
        " 00 DC 05 03 88 13 00 00 00 FF 00 53 99",
        MOVING_SIP,
    ),
    (
        "FA FB 28 33 D2 04 C8 7F 00 04 96 00 FA 00 7C 00 00 00 00 07 00 00 02"
        " 00 DC 05 03 88 13 00 00 00 FF 00 7C 00 00 AB 00 00 00 FF 15",
        replace(
            MOVING_SIP,
            tail=Tail.FAULT_FLAGS,
            battery_x10=124,
            charge_state=0,
            rotation_x10=171,
        ),
    ),
]
IDENTITY = (
    "FA FB 1B 02 4D 79 52 6F 62 6F 74 00 50 69 6F 6E 65 65 72 00 70 33 64 78 2D 73 68 00 B7 74"
)

marks = st.sampled_from([b"\xfa", b"\xfb", b"\xfa\xfb", b"\x00", b"\x01", b"\x03", b"\xff"])
noise = st.lists(marks | st.binary(max_size=4), max_size=40).map(b"".join)
payloads = st.binary(min_size=1, max_size=PAYLOAD_MAX)


@pytest.mark.parametrize(("wire", "request_"), COMMANDS, ids=[w for w, _ in COMMANDS])
def test_commands_are_those_on_the_wire(wire: str, request_: Request) -> None:
    data = bytes.fromhex(wire)
    assert request_.to_bytes() == data
    (packet,) = PacketDecoder().feed(data)
    assert packet.type == request_.number
    parsed = Request.parse(packet.payload)
    assert (parsed.number, parsed.string) == (request_.number, request_.string)
    assert (parsed.integer - request_.integer) % 0x10000 == 0  # either sign of a two-byte argument


@pytest.mark.parametrize(("wire", "value"), REPORTS, ids=["encoders", "p2os sip", "arcos sip"])
def test_reports_are_those_on_the_wire(wire: str, value: Value) -> None:
    data = bytes.fromhex(wire)
    (packet,) = PacketDecoder().feed(data)
    assert parse(packet.payload) == value
    assert frame(value.to_payload()) == data


def test_the_answer_to_sync2_says_who_the_robot_is() -> None:
    data = bytes.fromhex(IDENTITY)
    (packet,) = PacketDecoder().feed(data)
    identity = Identity("MyRobot", "Pioneer", "p3dx-sh")
    assert Identity.parse(packet.payload) == identity
    assert frame(identity.to_payload()) == data
    assert str(identity) == "MyRobot / Pioneer / p3dx-sh"
    assert Identity.parse(packet.payload[:-3]) is None


ALL_WIRES = [bytes.fromhex(wire) for wire, _ in [*COMMANDS, *REPORTS]] + [bytes.fromhex(IDENTITY)]


@pytest.mark.parametrize("wire", ALL_WIRES, ids=lambda wire: wire.hex(" "))
def test_a_packet_decodes_whole_byte_by_byte_and_with_bytes_behind_it(wire: bytes) -> None:
    whole = PacketDecoder().feed(wire)
    assert len(whole) == 1
    decoder = PacketDecoder()
    assert [p for byte in wire for p in decoder.feed(bytes([byte]))] == whole
    assert PacketDecoder().feed(wire + b"\xfa\xfb\x00\x17") == whole
    assert PacketDecoder().feed(wire[:-1]) == []


@given(st.lists(payloads, max_size=5), noise, st.lists(st.integers(1, 60), max_size=30))
def test_however_the_bytes_are_split_the_packets_are_the_same(
    carried: list[bytes], between: bytes, sizes: list[int]
) -> None:
    wire = between.join([b"", *(frame(payload) for payload in carried), bytes(300)])
    split, rest = PacketDecoder(), wire
    packets: list[Packet] = []
    for size in sizes:
        packets += split.feed(rest[:size])
        rest = rest[size:]
    packets += split.feed(rest)
    whole = PacketDecoder()
    expected = whole.feed(wire)
    assert packets == expected
    assert [p.offset for p in packets] == [p.offset for p in expected]
    assert split.stats == whole.stats


@given(noise | st.binary(max_size=600))
def test_no_input_raises_and_every_byte_is_accounted_for(data: bytes) -> None:
    decoder = PacketDecoder(is_config_with_wrong_checksum)
    packets = decoder.feed(data) + decoder.settle() + decoder.feed(bytes(300))
    for packet in packets:
        parse(packet.payload)
        Request.parse(packet.payload)
        Identity.parse(packet.payload)
    carried = sum(len(packet.payload) + 5 for packet in packets)
    assert carried + decoder.stats.noise_bytes == len(data) + 300
    assert decoder.stats.packets == len(packets)


@given(noise)
def test_a_packet_after_any_noise_arrives(before: bytes) -> None:
    decoder = PacketDecoder()
    packets = decoder.feed(before + frame(b"alive") + bytes(300))
    (offset,) = [packet.offset for packet in packets if packet == Packet(b"alive")][-1:]
    assert offset == len(before)


@given(payloads, st.integers(0, 8 * (PAYLOAD_MAX + 5) - 1))
def test_one_flipped_bit_is_never_taken_for_the_packet(payload: bytes, bit: int) -> None:
    wire = bytearray(frame(payload))
    wire[bit // 8 % len(wire)] ^= 1 << bit % 8
    assert Packet(payload) not in PacketDecoder().feed(bytes(wire) + bytes(300))


def test_headers_inside_a_payload_belong_to_it() -> None:
    inner = command(Cmd.STOP)
    assert PacketDecoder().feed(command(Cmd.TTY2, inner)) == [
        Packet(b"\x2a\x2b" + bytes([len(inner)]) + inner)
    ]


def test_after_a_pause_a_false_header_no_longer_holds_packets_back() -> None:
    decoder = PacketDecoder()
    assert decoder.feed(b"\xfa\xfb\xff" + frame(b"first") + b"\xfa\xfb\x08") == []
    assert decoder.settle() == [Packet(b"first")]
    assert decoder.feed(frame(b"second")[3:]) == [Packet(b"second")]
    assert decoder.stats.rejected == 1
    assert decoder.feed(b"\xfa\xfb\xff\xfa\xfb\x02\xfa\xfb\x00" + frame(b"third")) == []
    assert decoder.settle() == [Packet(b"third")]
    late = PacketDecoder()
    assert late.feed(frame(b"\xfa\xfb\x05 late packet")[:-2]) == []
    assert late.settle() == []
    assert late.feed(frame(b"\xfa\xfb\x05 late packet")[-2:]) == [
        Packet(b"\xfa\xfb\x05 late packet")
    ]


def test_a_packet_whose_end_is_lost_does_not_eat_the_next_one() -> None:
    decoder = PacketDecoder()
    assert decoder.feed(frame(b"its end is lost")[:-1]) == []
    assert decoder.settle() == []
    assert decoder.feed(b"\xfa") == []  # too little to tell
    assert decoder.settle() == []
    assert decoder.feed(frame(b"next")[1:]) == [Packet(b"next")]
    assert (decoder.stats.rejected, decoder.stats.noise_bytes) == (1, 19)
    assert decoder.feed(frame(b"\xfe late")[:-1]) == []
    assert decoder.settle() == []
    assert decoder.feed(frame(b"\xfe late")[-1:]) == [Packet(b"\xfe late")]
    for pieces in ([frame(b"next")], [b"\xfa", frame(b"next")[1:]]):  # as a chunk, and in two
        cut_off = PacketDecoder()
        assert cut_off.feed(frame(b"a long one that is cut off")[:-9]) == []
        assert cut_off.settle() == []
        assert [cut_off.feed(piece) for piece in pieces][-1] == [Packet(b"next")]


@given(st.lists(payloads, min_size=1, max_size=4), st.data())
def test_a_pause_anywhere_costs_no_packet_that_holds_no_header(
    carried: list[bytes], data: st.DataObject
) -> None:
    wire = b"".join(frame(payload) for payload in carried)
    cut = data.draw(st.integers(0, len(wire)))
    decoder = PacketDecoder()
    packets = decoder.feed(wire[:cut]) + decoder.settle() + decoder.feed(wire[cut:])
    if wire.count(b"\xfa\xfb") == len(carried) and not wire[:cut].endswith(b"\xfa"):
        assert packets == [Packet(payload) for payload in carried]


def test_a_damaged_packet_can_be_given_a_valid_checksum() -> None:
    cases = [(wire, at) for wire in ALL_WIRES for at in range(3, len(wire) - 2)]
    for wire, at in cases:
        assert with_checksum(wire) == wire
        damaged = wire[:at] + bytes([wire[at] ^ 0x41]) + wire[at + 1 :]
        (packet,) = PacketDecoder().feed(with_checksum(wire + damaged)[len(wire) :])
        assert packet.payload == damaged[3:-2]


@example(b"\xfa\xfb\x01\x00")  # no packet is so short
@example(frame(b"whole") + b"\xfa\xfb\x09cut")
@given(noise | st.binary(max_size=300))
def test_mending_checksums_keeps_the_length_and_takes_anything(data: bytes) -> None:
    mended = with_checksum(data)
    assert len(mended) == len(data)
    assert with_checksum(mended) == mended


def test_packets_know_where_they_began() -> None:
    decoder = PacketDecoder()
    decoder.feed(b"\x00\xfa\xfa\xfb\x00")
    first, second = decoder.feed(frame(b"one") + b"???" + frame(b"two"))
    assert (first.offset, second.offset) == (5, 5 + 8 + 3)


@pytest.mark.parametrize("length", [0, PAYLOAD_MAX + 1])
def test_packets_that_firmware_ignores_are_not_built(length: int) -> None:
    with pytest.raises(ValueError, match="carries 1 to 195 bytes"):
        frame(bytes(length))


def test_the_checksum_wraps_at_16_bits() -> None:
    assert checksum(bytes.fromhex("90 E8 03 00 00 FE FF FF FF")) == 0x941A
    assert checksum(b"\xff" * 4) == 0xFFFE


def test_an_argument_beyond_16_bits_is_refused() -> None:
    with pytest.raises(ValueError, match="70000 does not fit"):
        command(Cmd.MOVE, 70000)


@pytest.mark.parametrize(
    ("payload", "argument"),
    [
        ("07", None),
        ("07 3B", None),  # SETO as one client sends it
        ("0B 3B 05", 5),
        ("0B 77 05 00", None),
        ("2A 2B 02 41 42 00", b"AB"),  # a NUL behind the counted string
        ("2A 2B 09 41", b"A"),
    ],
)
def test_arguments_are_read_leniently(payload: str, argument: int | bytes | None) -> None:
    assert Request.parse(bytes.fromhex(payload)).argument == argument


@given(st.integers(-128, 127), st.integers(-128, 127))
def test_two_byte_arguments_mean_the_same_in_either_packing(left: int, right: int) -> None:
    joined = join_bytes(left, right)
    raw = joined & 0xFFFF  # another client sends the bytes as they are, always positive
    for argument in (joined, raw):
        parsed = Request.parse(PacketDecoder().feed(command(Cmd.VEL2, argument))[0].payload)
        assert split_bytes(parsed.integer) == (left, right)


def test_what_must_never_be_sent_is_known() -> None:
    assert {224, 239, 253, 255} <= FORBIDDEN
    assert not {Cmd.STOP, Cmd.E_STOP, Cmd.BATTEST} & FORBIDDEN


VALUES: list[Value] = [
    Gyro(((512, 25), (600, 26))),
    Io(b"\xff\x00", b"\x01", (0, 1023, 512)),
    Joystick(1, 0, 512, 1023, 7),
    GripperState(1, 2, 3),
    Battery((b"\x01\x02", b"\x03\x04")),
    Battery(()),
    SerAux(2, b"\xfe00\xef"),
    ResetNote(0xFE),
    replace(MOVING_SIP, tail=Tail.FLAGS_3, timestamp_us=2**32 - 1, flags_3=5, temperature=-20),
    replace(MOVING_SIP, sonar=(), stall_left=True, bumpers_rear=0x41, bumpers_front=0x12),
    Config("Pioneer", "p3dx-sh", "S1", name="r2", watchdog=2000, drift_factor=-12, firmware="3.0"),
]


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_what_is_built_is_read_back(value: Value) -> None:
    (packet,) = PacketDecoder().feed(frame(value.to_payload()))
    assert parse(packet.payload) == value


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_a_cut_payload_is_no_value_or_a_shorter_one(value: Value) -> None:
    payload = value.to_payload()
    for end in range(1, len(payload)):
        cut = parse(payload[:end])
        assert cut == payload[:end] or isinstance(cut, type(value))


def test_the_gyro_packet_has_the_manuals_length_and_scale() -> None:
    gyro = Gyro(((512, 0), (412, 0)))
    assert len(frame(gyro.to_payload())) - 3 == 4 + 3 * 2
    still, left = gyro.rates()
    assert still == 0
    assert left == pytest.approx(100 * 5 / 1023 * 300 / 2.5 * 1.626)


def test_unknown_packets_pass_as_they_are() -> None:
    assert parse(b"\x60laser") == b"\x60laser"


@pytest.mark.parametrize(
    ("tail", "length"),
    [
        (Tail.P2OS, 54),
        (Tail.FAULT_FLAGS, 61),
        (Tail.STATE_OF_CHARGE, 65),
    ],
)
def test_a_status_packet_with_eight_readings_has_its_known_length(tail: Tail, length: int) -> None:
    sip = Sip(sonar=tuple((disc, 5000) for disc in range(8)), tail=tail)
    assert len(frame(sip.to_payload())) == length


def test_the_finer_battery_field_is_preferred() -> None:
    assert Sip(battery=255).volts == 25.5
    assert Sip(battery=255, tail=Tail.BATTERY_X10, battery_x10=263).volts == 26.3


def test_a_status_packet_that_announces_more_sonar_than_it_holds_is_none() -> None:
    payload = bytearray(MOVING_SIP.to_payload())
    payload[19] = 9
    assert parse(bytes(payload)) == bytes(payload)
    assert Sip.parse(b"\x20" + bytes(40)) is None


# The start of a CONFIGpac captured from a P3DX-SH; its checksum was wrong, as on others.
CAPTURED_CONFIG = (
    b"\x20Pioneer\0p3dx-sh\0GJC_3156\0"
    + bytes([0])
    + bytes.fromhex("68 01 E8 03 2C 01 D0 07 F4 01")
    + b"FAPESP_3156\0"
    + bytes([100, 0])
)


def test_the_flash_parameters_of_a_real_robot_are_read_as_far_as_they_go() -> None:
    config = Config.parse(CAPTURED_CONFIG)
    assert (config.robot_class, config.subclass, config.serial) == (
        "Pioneer",
        "p3dx-sh",
        "GJC_3156",
    )
    assert (config.rot_vel_top, config.trans_vel_top) == (360, 1000)
    assert (config.rot_acc_top, config.trans_acc_top, config.pwm_max) == (300, 2000, 500)
    assert (config.name, config.sip_cycle, config.host_baud) == ("FAPESP_3156", 100, 0)
    assert config.watchdog == 0
    assert not config.is_believable


BELIEVABLE = Config(
    *("Pioneer", "p3dx-sh", "X"),
    rot_vel_top=360,
    trans_vel_top=1000,
    sip_cycle=100,
    watchdog=2000,
)


@pytest.mark.parametrize(
    "change",
    [
        {"subclass": ""},
        {"name": "x" * 21},
        {"serial": "\x07"},
        {"rot_vel_top": 0},
        {"trans_vel_top": 60000},
        {"sip_cycle": 0},
        {"watchdog": 0},
    ],
)
def test_impossible_flash_parameters_are_not_believed(change: dict[str, Any]) -> None:
    assert BELIEVABLE.is_believable
    assert not replace(BELIEVABLE, **change).is_believable


def test_only_flash_parameters_pass_with_a_wrong_checksum() -> None:
    def spoilt(payload: bytes) -> bytes:
        return frame(payload)[:-1] + bytes([frame(payload)[-1] ^ 1])

    decoder = PacketDecoder(is_config_with_wrong_checksum)
    assert decoder.feed(spoilt(MOVING_SIP.to_payload())) == []
    (packet,) = decoder.feed(spoilt(BELIEVABLE.to_payload()))
    assert not packet.is_intact
    assert parse(packet.payload) == BELIEVABLE
    assert PacketDecoder().feed(spoilt(BELIEVABLE.to_payload())) == []


# subtype, mm per unit, mm per sonar unit, rad/s per mm/s, sonar discs
FACTORS = [
    ("p2dx", 0.84, 0.268, 0.0056, 16),
    ("p2de", 0.969, 0.268, 0.0056, 16),
    ("p2ce", 0.826, 0.268, 0.0057, 16),
    ("p2at", 1.32, 0.268, 0.0034, 16),
    ("p2it", 1.136, 0.268, 0.0032, 16),
    ("p2d8", 0.485, 1, 0.0056, 16),
    ("p2d8+", 0.485, 1, 0.0056, 16),
    ("p2at8", 1.32, 1, 0.0034, 16),
    ("p2at8+", 0.465, 1, 0.0034, 16),
    ("p3dx", 0.485, 1, 0.0056, 16),
    ("p3dx-sh", 1.0, 1, 0.0056, 16),
    ("p3at", 0.465, 1, 0.0034, 16),
    ("P3AT-SH", 1.0, 1, 0.0034, 16),
    ("p3atiw-sh", 1.0, 1, 0.0034, 16),
    ("perfpb", 0.485, 1, 0.006, 32),
    ("perfpb+", 0.485, 1, 0.006, 32),
    ("peoplebot-sh", 1.0, 1, 0.006, 32),
    ("p2pb", 0.424, 0.268, 0.0056, 24),
    ("p2pp", 0.485, 0.268, 0.006, 24),
    ("amigo", 0.5083, 1, 0.011, 8),
    ("amigo-sh", 1.0, 1, 0.011, 8),
    ("powerbot", 0.5813, 1, 0.00373, 32),
    ("powerbot-sh", 1.0, 1, 0.00373, 32),
    ("patrolbot-sh", 1.0, 1, 0.0056, 16),
    ("researchPB", 1.0, 1, 0.0056, 16),
    ("pion1m", 0.05066, 0.1734, 0.00333, 7),
    ("pionat", 0.07, 0.1734, 0.00333, 7),
]


@pytest.mark.parametrize(("subtype", "distance", "range_", "difference", "discs"), FACTORS)
def test_each_subtype_has_its_units(
    subtype: str, distance: float, range_: float, difference: float, discs: int
) -> None:
    model = find(subtype)
    assert model is not None
    assert (model.distance, model.range, model.difference, model.discs) == (
        distance,
        range_,
        difference,
        discs,
    )
    assert len(model.ring) in (0, discs)


def test_all_models_are_checked_and_others_are_unknown() -> None:
    assert {subtype.lower() for subtype, *_ in FACTORS} == set(MODELS)
    assert find("roomba") is None


def test_sonar_discs_look_outwards() -> None:
    ring = MODELS["p3dx-sh"]
    left, back = ring.base_from_disc(0), ring.base_from_disc(11)
    assert left is not None
    assert back is not None
    assert (left.x, left.y, left.theta) == pytest.approx((0.069, 0.136, 1.5708), abs=1e-4)
    assert (back.x, back.y) == (-0.255, -0.027)
    assert ring.base_from_disc(16) is None
    assert MODELS["powerbot-sh"].base_from_disc(7) is None  # not fitted
    for subtype, model in MODELS.items():
        # the patrolbot's ring stands out over its base
        over = 20 if subtype == "patrolbot-sh" else 0
        for x, y, angle in filter(None, model.ring):
            assert -model.rear - over <= x <= model.front + over
            assert abs(y) <= model.width / 2 + over
            assert x * cos(radians(angle)) + y * sin(radians(angle)) > 0


def test_a_packet_is_known_by_its_first_bytes() -> None:
    decoder, packet = PacketDecoder(), frame(b"\x32abcdef")
    begun = []
    for part in (b"\x00\x01" + packet[:3], packet[3:5]):
        decoder.feed(part)
        begun.append(decoder.begun)
    decoder.settle()  # after a pause it may be a torso
    begun.append(decoder.begun)
    decoder.feed(packet[5:])
    assert [*begun, decoder.begun] == [None, (0x32, 2), None, None]
