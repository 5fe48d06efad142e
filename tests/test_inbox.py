"""What came over a link waits for its reader, who is woken no more often than he must be."""

import asyncio

import pytest

from followerd import clock
from followerd.errors import LinkLost
from followerd.hw.inbox import ByteInbox
from followerd.hw.stream import Received


async def settled() -> None:
    for _ in range(5):
        await asyncio.sleep(0)


def test_a_reader_who_needs_many_bytes_sleeps_until_they_are_there() -> None:
    async def story() -> None:
        inbox = ByteInbox(8)
        reading = asyncio.create_task(inbox.take(100))
        for _ in range(3):
            await settled()
            assert not reading.done()
            inbox.put(Received(bytes(30), clock.now()))
        await settled()
        assert not reading.done()
        inbox.put(Received(bytes(10), clock.now()))
        assert len((await reading).data) == 30
        assert [len((await inbox.take(1000)).data) for _ in range(3)] == [30, 30, 10]

    clock.run_virtual(story())


def test_a_lost_link_wakes_him_though_nothing_came() -> None:
    async def story() -> None:
        inbox = ByteInbox(8)
        reading = asyncio.create_task(inbox.take(100))
        await settled()
        inbox.fail(LinkLost("laser", "unplugged"))
        with pytest.raises(LinkLost):
            await reading

    clock.run_virtual(story())


def test_what_was_forgotten_or_overflowed_counts_no_longer() -> None:
    async def story() -> None:
        inbox = ByteInbox(2)
        for _ in range(5):
            inbox.put(Received(bytes(50), 0.0))
        inbox.clear()
        reading = asyncio.create_task(inbox.take(60))
        await settled()
        inbox.put(Received(bytes(50), 0.0))
        await settled()
        assert not reading.done()
        inbox.put(Received(bytes(10), 0.0))
        assert len((await reading).data) == 50

    clock.run_virtual(story())
