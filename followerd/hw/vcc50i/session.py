"""One open line to the camera: a request out, its answer in, one at a time.

An answer does not say what it answers. So a request waits for the last one's answer, and after a
silence the line is let fall quiet before anything else is asked.
"""

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.stream import ByteStream
from followerd.hw.vcc50i.protocol import Answer, Errors, Frame, FrameDecoder, Request

TRIES = 4
PATIENCE = 0.7  # s for an answer: 0.3 says the manual, and the base's AUX port adds its own
PAUSE = 0.25  # s in mid-answer after which its rest is lost
ROUNDING = 1e-6  # s
QUIET, NOISY = 0.05, 0.3  # s without a byte after a silence; s to wait for that at most


class Refused(Exception):
    """The camera does not do it; `errors` says why."""

    def __init__(self, request: Request, errors: Errors) -> None:
        super().__init__(f"{request.to_bytes().hex(' ')} is refused ({errors.name})")
        self.errors = errors


class Busy(Refused):
    """The camera is still at something else."""


class WrongMode(Refused):
    """The camera is off, not initialised, or under its remote control's control."""


class Session:
    """Asks over a stream; raises LinkLost as the stream does, and when nothing answers."""

    def __init__(self, stream: ByteStream, baud: int, device: str) -> None:
        self.asked = 0.0  # s, when the last request had crossed the line
        self._stream = stream
        self._baud = baud
        self._device = device
        self._decoder = FrameDecoder()

    async def ask(self, request: Request, length: int | None = 0) -> bytes:
        """The data in the answer, of `length` bytes (None: any); raises Refused and LinkLost.

        A request that seems wrong to the camera is repeated: it may have been damaged under way.
        """
        refusal: Refused | None = None
        for _ in range(TRIES):
            answer = await self._answer_to(request)
            if answer is None:
                await self.settle()
            elif answer.errors & Errors.MODE:
                raise WrongMode(request, answer.errors)
            elif answer.errors == Errors.BUSY:
                raise Busy(request, answer.errors)
            elif answer.errors:
                refusal = Refused(request, answer.errors)
            elif length is None or len(answer.data) == length:
                return answer.data
            else:
                await self.settle()
        raise refusal or LinkLost(
            self._device, "the camera does not answer", "check its power and cable (CTS is needed)"
        )

    async def tell(self, request: Request) -> None:
        """Have something done; raises Refused and LinkLost."""
        await self.ask(request)

    async def settle(self) -> None:
        """Let late answers come, to be forgotten."""
        until = clock.now() + NOISY
        while clock.now() < until:
            if await clock.within(QUIET, self._stream.read()) is None:
                break
        self._decoder.feed(b"\xff")  # what has begun will not be ended

    async def _answer_to(self, request: Request) -> Answer | None:
        self._stream.discard_input()
        data = request.to_bytes()
        self._stream.write(data)
        self.asked = clock.now() + 10.0 * len(data) / self._baud
        until = clock.now() + PATIENCE
        too_early: Answer | None = None  # but what no serial line paces may be as quick
        while (left := until - clock.now()) > 0:
            received = await clock.within(left, self._stream.read())
            if received is None:
                break
            for frame in self._decoder.feed(received.data):
                answer = Answer.parse(frame)
                if answer is not None and not self._is_of_before(frame, received.stamp):
                    return answer
                too_early = answer or too_early
            until = min(until, clock.now() + PAUSE)
        return too_early

    def _is_of_before(self, frame: Frame, stamp: float) -> bool:
        """Whether it began to come before the last request had crossed the line."""
        return stamp - 10.0 * len(frame.to_bytes()) / self._baud < self.asked - ROUNDING
