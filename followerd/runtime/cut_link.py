"""A link whose way to the device can be cut, as a broken wire does: what is written gets lost."""

from followerd import clock
from followerd.hw.stream import ByteStream, Link, Received


class CutLink:
    """Wraps a link; while it is cut, its stream still reads.

    A driver does not notice, and may come to believe that what it wrote was heard. So the first
    words after the cut are ours: for a base, what clears the setpoints that it kept.
    """

    def __init__(self, link: Link, first_words: bytes) -> None:
        """`first_words` are written before anything else when the wire is whole again."""
        self.name = link.name
        self.silent_since = 0.0  # s, when bytes last got through
        self.is_cut = False
        self._link = link
        self._first_words = first_words
        self._stream: ByteStream | None = None

    async def open(self, device: str, baud: int) -> "CutStream":
        """See Link."""
        self._stream = await self._link.open(device, baud)
        return CutStream(self._stream, self)

    def mend(self) -> None:
        """Let bytes through again; raises LinkLost."""
        if self.is_cut and self._stream is not None:
            self.is_cut = False
            self._stream.write(self._first_words)


class CutStream:
    """An open stream of a CutLink; see ByteStream."""

    def __init__(self, stream: ByteStream, link: CutLink) -> None:
        self._stream = stream
        self._link = link
        self.drain = stream.drain
        self.set_baud = stream.set_baud
        self.discard_input = stream.discard_input
        self.close = stream.close

    async def read(self, at_least: int = 1) -> Received:
        """See ByteStream."""
        return await self._stream.read(at_least)

    def write(self, data: bytes) -> None:
        """Send, unless it is cut."""
        if not self._link.is_cut:
            self._stream.write(data)
            self._link.silent_since = clock.now()
