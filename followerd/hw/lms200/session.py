"""One open line to an LMS2xx: requests out, events in. It knows telegrams, not their purpose."""

from collections import deque
from collections.abc import Callable

from followerd import clock
from followerd.hw.lms200.protocol import Acknowledgement, Event, Telegram, TelegramDecoder
from followerd.hw.lms200.sweep import Sweep
from followerd.hw.lms200.telegrams import Command, Reply, reply_to, request
from followerd.hw.lms200.variant import VARIANTS, line_time
from followerd.hw.stream import ArrivalTimes, ByteStream

TRIES = 3
ACKNOWLEDGED = 0.3  # s; devices take some 60 ms
ANSWERED: dict[int, float] = {Command.MODE: 3.0, Command.WRITE_CONFIG: 15.0}  # s; the rest:
ANSWERED_ELSE = 1.0
AFTER_NAK = 0.03  # s that the device wants before the request is repeated
GAP = 0.05  # s without a byte, beyond a USB adapter's chunk, that ends a telegram
CHUNK = 62  # bytes, of a USB adapter
LONGEST_SCAN = max(Sweep(variant).telegram_bytes for variant in VARIANTS)


class NoAnswer(Exception):
    """The device does not answer; the text says to what."""


class Refused(Exception):
    """The device says that a request is not allowed; the text names it."""


class Rebooted(Exception):
    """The device announced, unasked, that it has started."""


class Session:
    """Owns the decoder of a stream; `baud` is the line rate now."""

    def __init__(self, stream: ByteStream, baud: int) -> None:
        self.baud = baud
        self.decoder = TelegramDecoder()
        self.received_bytes = 0
        self.received_at = 0.0  # s, when the newest came
        self._stream = stream
        self._arrivals = ArrivalTimes(keep=1024)
        self._events: deque[Event] = deque()
        self._told_to = 0  # offset in the stream up to which beginnings were told
        self._noise_before = 0  # noise bytes when the last request was sent

    @property
    def in_flight(self) -> float:
        """Seconds that a scan may take whose telegram began before a request."""
        return line_time(LONGEST_SCAN, self.baud)

    def arrived_at(self, telegram: Telegram) -> float:
        """When the telegram's first byte came, s."""
        return self._arrivals.at(telegram.offset, self.baud)

    async def event(self, expected: int = 1, begun: Callable[[bytes], None] | None = None) -> Event:
        """The next telegram or acknowledgement; raises LinkLost.

        To expect a telegram of so many bytes saves wake-ups, but what is shorter is then heard of
        only after another read. What came of a telegram that is not complete is told to `begun`.
        """
        while not self._events:
            if begun is not None:
                self._tell(begun, expected)
            received = await self._stream.read(self._wanted(expected, begun is not None))
            self._arrivals.add(received)
            self.received_at = received.stamp
            self.received_bytes += len(received.data)
            self._events.extend(self.decoder.feed(received.data))
        return self._events.popleft()

    def _tell(self, begun: Callable[[bytes], None], least: int) -> None:
        """Of all that may be a telegram's beginning, once `least` bytes of it are here."""
        for offset, first in self.decoder.beginnings(self._told_to, least):
            self._told_to = offset + 1
            begun(first)

    def _wanted(self, expected: int, is_told: bool) -> int:
        """Bytes to wait for; who is told of beginnings wants the one in a cut telegram too."""
        if expected == 1 or not self.decoder.is_midway:
            return expected
        if not is_told:
            return self.decoder.missing
        here = self.decoder.pending
        return expected - here if here < expected else min(self.decoder.missing, CHUNK)

    async def request(self, command: int, data: bytes = b"") -> Telegram:
        """Send, repeat when refused by NAK or not acknowledged, and return the answer.

        Raises NoAnswer, Refused, Rebooted or LinkLost. Scans that are still streamed are skipped.
        """
        reply = reply_to(command)
        may_be_late = False
        for _ in range(TRIES):
            self.send(command, data)
            first = await self.await_one(reply, self.in_flight + ACKNOWLEDGED, or_mark=True)
            if first is Acknowledgement.ACK:
                first = await self.await_one(reply, ANSWERED.get(command, ANSWERED_ELSE))
            if isinstance(first, Telegram):
                if may_be_late:  # rather than lost; it must not answer the next request
                    await self.await_one(reply, ACKNOWLEDGED)
                return first
            may_be_late = first is None
            await clock.sleep(AFTER_NAK)
        raise NoAnswer(f"no answer to {Command(command).name} at {self.baud} baud")

    def send(self, command: int, data: bytes = b"") -> None:
        """Send a request; events before it are forgotten, a telegram in flight is not cut."""
        self._events.clear()
        self._noise_before = self.decoder.noise_bytes
        self._stream.write(request(command, data).to_bytes())

    async def await_one(
        self, reply: int, patience: float, *, or_mark: bool = False
    ) -> Event | None:
        """The first telegram `reply` (or acknowledgement) within `patience` seconds.

        Amid noise a single byte proves nothing: acknowledgements there are not believed.
        Raises Refused, Rebooted or LinkLost.
        """
        deadline = clock.now() + patience
        while (left := deadline - clock.now()) > 0:
            event = await clock.within(min(left, self._gap), self.event())
            if event is None:
                self.give_up_if_silent()
            elif isinstance(event, Acknowledgement):
                if or_mark and self.decoder.noise_bytes == self._noise_before:
                    return event
            elif event.command == reply:
                return event
            elif event.command == Reply.NOT_ALLOWED:
                raise Refused(Reply(reply).name)
            elif event.command == Reply.POWER_ON:
                raise Rebooted
        return None

    def give_up_if_silent(self) -> None:
        """After a pause, what seemed the begin of a telegram was none; look what stands behind."""
        if clock.now() - self.received_at > self._gap:
            self._events.extend(self.decoder.give_up())

    @property
    def _gap(self) -> float:
        return GAP + line_time(CHUNK, self.baud)

    async def set_baud(self, baud: int) -> None:
        """Change the line rate, once everything written has left."""
        await self._stream.drain()
        self._stream.set_baud(baud)
        self._stream.discard_input()
        self.decoder.give_up()
        self._events.clear()
        self.baud = baud
