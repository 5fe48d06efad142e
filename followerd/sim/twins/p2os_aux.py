"""The AUX ports of the simulated controller: a small buffer between a device and GETAUX.

GETAUX n is answered once, when n bytes are there; n = 0 flushes. What exceeds the buffer is lost.
Whether a new GETAUX replaces a pending one no manual says: `queues` models the other way.
"""

from collections import deque
from math import inf

import numpy as np

from followerd.sim.interfaces import Twin

BUFFER = 253  # bytes of a port's receive buffer
BITS_PER_BYTE = 10
EPSILON = 1e-9  # s


class AuxPort:
    """One port; time is that of the controller."""

    def __init__(self, flash_baud: int, rng: np.random.Generator, queues: bool = False) -> None:
        self.device: Twin | None = None
        self.baud = flash_baud
        self._flash_baud = flash_baud
        self._rng = rng
        self._queues = queues
        self._received = bytearray()
        self._wanted: deque[int] = deque()
        self._to_device: deque[tuple[float, bytes]] = deque()  # (s, last byte has crossed; bytes)
        self._from_device: deque[tuple[float, int]] = deque()  # (s, has crossed; byte)
        self._out_free = self._in_free = 0.0  # s, when each direction of the line is free

    def reset(self) -> None:
        """As after power-up."""
        self.baud = self._flash_baud
        self._received.clear()
        self._wanted.clear()

    def write(self, data: bytes, now: float) -> None:
        """TTY: bytes that start to leave towards the device."""
        start = max(now, self._out_free)
        self._out_free = start + len(data) * BITS_PER_BYTE / self.baud
        self._to_device.append((self._out_free, self._as_heard(data)))

    def fetch(self, count: int) -> None:
        """GETAUX."""
        if count == 0:
            self._received.clear()
        if count == 0 or not self._queues:
            self._wanted.clear()
        if count:
            self._wanted.append(min(count, BUFFER))

    def answer(self) -> bytes:
        """What a pending GETAUX asked for, if it is there; `taken` confirms that it was sent."""
        if not self._wanted or self._wanted[0] > len(self._received):
            return b""
        return bytes(self._received[: self._wanted[0]])

    def taken(self) -> None:
        """The answer was sent."""
        del self._received[: self._wanted.popleft()]

    def advance(self, now: float) -> None:
        """Carry bytes both ways, and let the device act, up to `now`."""
        if self.device is None:
            self._to_device.clear()
            return
        horizon = now + EPSILON
        while (due := self.wake_at()) <= horizon:
            while self._from_device and self._from_device[0][0] <= due:
                self._receive(self._from_device.popleft()[1])
            while self._to_device and self._to_device[0][0] <= due:
                self.device.receive(self._to_device.popleft()[1], due)
            self._hear(self.device.step(due), due)

    def wake_at(self) -> float:
        """When `advance` has something to do next."""
        if self.device is None:
            return inf
        due = self.device.wake_at()
        for queue in (self._to_device, self._from_device):
            if queue:
                due = min(due, queue[0][0])
        return due

    def _hear(self, data: bytes, now: float) -> None:
        start = max(now, self._in_free)
        rate = self.device.baud if self.device is not None else self.baud
        for count, byte in enumerate(self._as_heard(data), 1):
            self._from_device.append((start + count * BITS_PER_BYTE / rate, byte))
        self._in_free = start + len(data) * BITS_PER_BYTE / rate

    def _receive(self, byte: int) -> None:
        if len(self._received) < BUFFER:
            self._received.append(byte)

    def _as_heard(self, data: bytes) -> bytes:
        """Noise, when both ends are at different rates."""
        same = self.device is None or self.device.baud == self.baud
        return data if same else self._rng.bytes(len(data))
