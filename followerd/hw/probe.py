"""What is on a serial port: it is listened to first, then asked in one device's words at a time.

Nobody can be moved by it. A base is spoken to first, at every rate, and what it hears begins with
STOP, VEL 0, RVEL 0 and CLOSE, before any SYNC0, which is also PULSE: when the first word for
another device leaves, no setpoint is left that any byte could revive, and the motors are off. Nor
could one: packets begin with FA FB and end in their checksum, and neither byte occurs in what a
laser (02, address, length, payload, CRC) or a camera's head (FF, ASCII, EF) is asked here. A laser
takes no P2OS packet for a telegram: where an STX stands in one, length and CRC do not fit. A head
hears no FF from others; it is asked for its status and its name only. (The tests put all that is
said before each decoder.)
"""

from collections.abc import Callable

from followerd import clock
from followerd.errors import DeviceError, OpenError, SetupError
from followerd.hw.lms200 import probe as lms200
from followerd.hw.lms200.probe import LaserFound
from followerd.hw.lms200.protocol import Telegram, TelegramDecoder
from followerd.hw.lms200.session import LONGEST_SCAN, NoAnswer, Rebooted, Refused
from followerd.hw.lms200.session import Session as LaserSession
from followerd.hw.lms200.telegrams import POWER_ON_BAUD, BadTelegram, Reply
from followerd.hw.lms200.variant import line_time
from followerd.hw.p2os import probe as p2os
from followerd.hw.p2os.packet_stream import PacketStream
from followerd.hw.p2os.probe import RobotFound
from followerd.hw.p2os.protocol import PacketDecoder
from followerd.hw.p2os.sip import TYPES, Sip
from followerd.hw.stream import ByteStream, Link
from followerd.hw.vcc50i import probe as vcc50i
from followerd.hw.vcc50i.probe import HeadFound

LIMIT = 12.0  # s for a port
BOOTING = 60  # s that a laser may take
QUIET = 0.3  # s; whoever reports unasked does so more often
SWEEPS = 2  # a first word may be lost
TEXT, TEXT_SHARE = 24, 0.95  # bytes from which on, and share of printable ones above which, it is
RATES = (9600, 38400, 19200, 115200, 57600, 500000)  # by how often they are met
NETWORK = "socket://"  # the far end sets the rate
DEVICE = "port"

Found = RobotFound | LaserFound | HeadFound
Tell = Callable[[str], None]


class Unidentified(Exception):
    """Nothing that we know is there; says what is known, and what to do."""


class Ear:
    """What is overheard at one line rate. No I/O, no clock."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.laser_reboots = False
        self._packets = PacketDecoder()
        self._telegrams = TelegramDecoder()

    def hear(self, data: bytes) -> type[Found] | None:
        """Who speaks; None when that is not known yet."""
        self.heard += data
        for packet in self._packets.feed(data):
            if packet.type in TYPES and Sip.parse(packet.payload) is not None:
                return RobotFound
        for event in self._telegrams.feed(data):
            if isinstance(event, Telegram):
                self.laser_reboots = event.command == Reply.POWER_ON
                return LaserFound
        return None

    @property
    def text(self) -> str:
        """The begin of what is heard, when that is text; then another device speaks."""
        start = bytes(self.heard[:80])
        readable = sum(32 <= byte < 127 or byte in b"\r\n\t" for byte in start)
        if len(start) < TEXT or readable < TEXT_SHARE * len(start):
            return ""
        return " ".join(start.decode("ascii", "replace").split())[:40]


async def probe(link: Link, tell: Tell) -> Found:
    """The device on `link`, within LIMIT; `tell` is called with what is being done.

    It is left without a session and at rest. Raises Unidentified with the reason, OpenError too.
    """
    stream = await link.open(DEVICE, RATES[0])
    rates = RATES[:1] if link.name.startswith(NETWORK) else RATES
    port = _Port(stream, rates, tell)
    try:
        found = await clock.within(LIMIT, port.identify())
    except DeviceError as error:
        raise Unidentified(f"{error.problem}; {error.remedy}".rstrip("; ")) from error
    except (NoAnswer, Refused, Rebooted, BadTelegram) as reason:
        raise Unidentified(f"a laser, but {str(reason) or 'it reboots'}; try again") from reason
    finally:
        stream.close()
    if found is None:
        raise Unidentified(port.silence())
    return found


def why_closed(error: OpenError) -> str:
    """Why a port does not open, without its name in front."""
    return f"{error.problem}; {error.remedy}" if error.remedy else error.problem


class _Port:
    """An open port, and how far we are with it."""

    def __init__(self, stream: ByteStream, rates: tuple[int, ...], tell: Tell) -> None:
        self._stream = stream
        self._rates = rates
        self._tell = tell
        self._begun = clock.now()
        self._noise = 0  # bytes that nobody we know would send
        self._known = ""  # who answered, but not fully

    async def identify(self) -> Found | None:
        """Listen, ask at all rates, listen again until a booting laser speaks."""
        found = await self._overhear()
        if found is None:
            self._tell(f"asking at {', '.join(map(str, self._rates))} baud")
        for sweep in range(1 if self._noise else SWEEPS):
            if sweep:
                self._tell("asking once more at all rates")
            for ask in (self._ask_a_base, self._ask_others):
                for baud in self._rates:
                    found = found or await ask(baud)
        return found or await self._await_boot()

    def silence(self) -> str:
        """What to say of a port that did not tell who is there."""
        if self._known:
            return f"{self._known} answers, but not to the end; try again"
        if self._noise:
            return (
                "something talks, at no rate as a P2OS base, an LMS2xx or a VC-C50i does; "
                "500000 baud needs an RS-422 adapter that can do it, RS-422 its pairs the right way"
            )
        return (
            f"nothing answers within {LIMIT:.0f} s: no device, no power, crossed wires, or a laser"
            f" that still boots (up to {BOOTING} s): then try again"
        )

    # Listening

    async def _overhear(self) -> Found | None:
        for baud in self._rates:
            if not await self._set_baud(baud):
                continue
            ear, speaker = Ear(), None
            until = clock.now() + QUIET
            while speaker is None and (left := until - clock.now()) > 0:
                received = await clock.within(left, self._stream.read())
                if received is None:
                    break
                if not ear.heard:  # a telegram may have begun before: wait for a whole one
                    until = clock.now() + QUIET + 2 * self._longest(baud)
                speaker = ear.hear(received.data)
            if speaker is not None:
                return await self._met(speaker, baud, ear)
            if ear.text:
                raise Unidentified(
                    f"another device sends text at {baud} baud ({ear.text!r}); it was asked nothing"
                )
            if not ear.heard:
                return None  # who speaks is heard, if not understood, at any rate
            self._noise += len(ear.heard)
            self._tell(f"hears what makes no sense at {baud} baud")
        return None

    def _longest(self, baud: int) -> float:
        """Seconds of the longest telegram that is sent unasked at a rate."""
        return line_time(LONGEST_SCAN, baud) if baud in lms200.RATES else 0.0

    async def _await_boot(self) -> Found | None:
        """Nobody answers: a laser says so when it has booted."""
        await self._set_baud(POWER_ON_BAUD)
        left = LIMIT - (clock.now() - self._begun)
        self._tell(
            f"silent at every rate; a laser that was just switched on (opening its port may do"
            f" that) boots for up to {BOOTING} s: listening for {max(left, 0.0):.0f} s more"
        )
        ear = Ear()
        while True:
            speaker = ear.hear((await self._stream.read()).data)
            if speaker is not None:
                return await self._met(speaker, POWER_ON_BAUD, ear)

    async def _met(self, speaker: type[Found], baud: int, ear: Ear) -> Found:
        if speaker is RobotFound:
            self._tell(f"a P2OS base reports at {baud} baud: it is stopped, its session closed")
            return await self._robot(baud)
        self._tell(f"a laser {'has booted' if ear.laser_reboots else 'streams'} at {baud} baud")
        return await self._laser(baud, was_streaming=not ear.laser_reboots)

    # Asking

    async def _ask_a_base(self, baud: int) -> Found | None:
        if baud not in p2os.RATES or not await self._set_baud(baud):
            return None
        answers = await p2os.knock(PacketStream(self._stream, baud))
        return await self._robot(baud) if answers else None

    async def _ask_others(self, baud: int) -> Found | None:
        if baud not in (*lms200.RATES, *vcc50i.RATES) or not await self._set_baud(baud):
            return None
        if baud in lms200.RATES and await lms200.knock(LaserSession(self._stream, baud)):
            return await self._laser(baud, was_streaming=False)
        return await vcc50i.knock(self._stream, baud) if baud in vcc50i.RATES else None

    async def _robot(self, baud: int) -> RobotFound:
        self._known = "a P2OS base"
        return await p2os.introduce(PacketStream(self._stream, baud), DEVICE)

    async def _laser(self, baud: int, *, was_streaming: bool) -> LaserFound:
        self._known = "a laser"
        session = LaserSession(self._stream, baud)
        return await lms200.introduce(session, was_streaming=was_streaming)

    async def _set_baud(self, baud: int) -> bool:
        """Whether the adapter can."""
        await self._stream.drain()
        try:
            self._stream.set_baud(baud)
        except SetupError:
            self._tell(f"this adapter cannot do {baud} baud")
            return False
        self._stream.discard_input()
        return True
