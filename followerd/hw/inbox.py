"""What came in over a link and was not taken yet."""

import asyncio
from collections import deque
from typing import Generic, TypeVar

from followerd.errors import LinkLost
from followerd.hw.stream import Received

T = TypeVar("T")

CHUNKS = 1024  # kept for a reader of bytes that lags; then the oldest are lost, as in a UART


class Inbox(Generic[T]):
    """A bounded queue with one reader, which can be told that the link is gone.

    When `keep` items wait, the oldest is lost for the next one; 1 keeps just the newest.
    """

    def __init__(self, keep: int) -> None:
        self._items: deque[T] = deque(maxlen=keep)
        self._waiter: asyncio.Future[None] | None = None
        self._lost: LinkLost | None = None

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits to be taken."""
        return not self._items

    def put(self, item: T) -> None:
        """Add an item and wake the reader."""
        self._items.append(item)
        self._notify()

    def fail(self, lost: LinkLost) -> None:
        """The link is gone: the reader is told so at once; the first report stays."""
        self._lost = self._lost or lost
        self._notify()

    def check(self) -> None:
        """Raise LinkLost when the link is gone."""
        if self._lost is not None:
            raise LinkLost(self._lost.device, self._lost.problem, self._lost.remedy)

    async def get(self) -> T:
        """The oldest item; raises LinkLost when the link is gone."""
        if not self._items or self._lost is not None:
            await self._wait()
        return self._items.popleft()

    def clear(self) -> None:
        """Forget what was not taken."""
        self._items.clear()

    async def _wait(self) -> None:
        """Until something is there to be taken; raises LinkLost."""
        self.check()
        while not self._items:
            self._waiter = asyncio.get_running_loop().create_future()
            await self._waiter
            self.check()

    def _notify(self) -> None:
        if self._waiter is not None and not self._waiter.done():
            self._waiter.set_result(None)


class ByteInbox(Inbox[Received]):
    """Chunks of bytes. A reader that needs many is left asleep until they are there."""

    def __init__(self, keep: int) -> None:
        super().__init__(keep)
        self._count = 0  # bytes that wait
        self._needed = 1

    def put(self, item: Received) -> None:
        """Add a chunk; wake the reader when what it needs is there."""
        if len(self._items) == self._items.maxlen:
            self._count -= len(self._items[0].data)
        self._items.append(item)
        self._count += len(item.data)
        if self._count >= self._needed:
            self._notify()

    @property
    def missing(self) -> int:
        """Bytes, at least 1, that must come until there is something for the reader to do."""
        return max(1, self._needed - self._count)

    async def take(self, at_least: int) -> Received:
        """The oldest chunk; when there is none, waits for `at_least` bytes. Raises LinkLost."""
        if not self._items or self._lost is not None:
            self._needed = at_least
            try:
                await self._wait()
            finally:
                self._needed = 1
        item = self._items.popleft()
        self._count -= len(item.data)
        return item

    def clear(self) -> None:
        """Forget what was not taken."""
        super().clear()
        self._count = 0
