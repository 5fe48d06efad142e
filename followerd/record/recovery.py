"""Makes a whole file of one that a crash cut off."""

from collections.abc import Callable
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from followerd.errors import UsageError
from followerd.record.reading import BROKEN


def recover(source: Path, out: Path) -> tuple[int, str]:
    """Copy every complete record of `source` to `out`: how many messages, and where it broke off.

    Raises UsageError when `out` exists or cannot be written, or `source` is no MCAP file.
    """
    if out.exists():
        raise UsageError(f"{out} exists; give another --out")
    count, broken = 0, ""
    try:
        with source.open("rb") as stream, out.open("wb") as file:
            writer = Writer(file, compression=CompressionType.LZ4)
            writer.start("", "followerd recover")
            copy = _Copy(writer)
            try:
                for record in StreamReader(stream, record_size_limit=None).records:
                    count += copy.take(record)
            except BROKEN as error:
                broken = f"{type(error).__name__} {error}".strip()
            finish: Callable[[], None] = writer.finish  # untyped there
            finish()
    except OSError as error:
        raise UsageError(f"{error.filename or out}: {error.strerror}") from None
    if not count and broken:
        out.unlink()
        raise UsageError(f"{source}: nothing to recover: {broken}")
    return count, broken


class _Copy:
    """Schemas and channels get new numbers."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}

    def take(self, record: object) -> bool:
        """Copy one record; whether it was a message."""
        w = self._writer
        if isinstance(record, Schema) and record.id not in self._schemas:
            number = w.register_schema(record.name, record.encoding, record.data)
            self._schemas[record.id] = number
        elif isinstance(record, Channel) and record.id not in self._channels:
            schema = self._schemas[record.schema_id]
            number = w.register_channel(record.topic, record.message_encoding, schema)
            self._channels[record.id] = number
        elif isinstance(record, Metadata):
            w.add_metadata(record.name, record.metadata)
        elif isinstance(record, Message):
            w.add_message(
                self._channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
            return True
        return False
