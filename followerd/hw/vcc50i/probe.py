"""Whether a Canon camera is on a line: asked for its status and name, which moves nothing."""

from dataclasses import dataclass

from followerd import clock
from followerd.hw.stream import ByteStream
from followerd.hw.vcc50i.commands import KNOWN_STATUS, STATUS, STATUS_DIGITS, Cmd, Status
from followerd.hw.vcc50i.protocol import BAUD, Answer, Errors, FrameDecoder, Request, number

RATES = (BAUD,)
ANSWER = 0.4  # s; the manual promises 0.3
NAME = Request(Cmd.NAME)


@dataclass(frozen=True, slots=True)
class HeadFound:
    """What a camera head said of itself."""

    name: str  # empty: it does not tell
    status: Status
    baud: int

    def __str__(self) -> str:
        text = f"Canon pan-tilt head {self.name or '(tells no name now)'}, {self.baud} baud"
        return text + (", switched off" if self.status & Status.CAMERA_OFF else "")


async def knock(stream: ByteStream, baud: int) -> HeadFound | None:
    """The camera that answers at the stream's rate; raises LinkLost."""
    answer = await _answer_to(stream, STATUS)
    value = None if answer is None or answer.errors else number(answer.data)
    if answer is None or value is None or len(answer.data) != STATUS_DIGITS:
        return None
    named = await _answer_to(stream, NAME)
    name = "" if named is None or named.errors else named.data.decode("ascii").strip()
    return HeadFound(name, Status(value & KNOWN_STATUS), baud)


async def _answer_to(stream: ByteStream, request: Request) -> Answer | None:
    stream.discard_input()
    stream.write(request.to_bytes())
    return await clock.within(ANSWER, _next_answer(stream))


async def _next_answer(stream: ByteStream) -> Answer:
    decoder = FrameDecoder()
    while True:
        for frame in decoder.feed((await stream.read()).data):
            answer = Answer.parse(frame)
            if answer is not None and not answer.errors & Errors.SYSTEM:
                return answer
