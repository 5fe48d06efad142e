"""Pictures drawn in a process of their own, while their world goes on.

A picture follows from its shot and from the pictures before it, so it is the same wherever it is
drawn; and it is not looked at before the camera has been read out. In virtual time a run on its
own thus uses a second core for the quarter of its work that can wait so long.
"""

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection

import cv2
import numpy as np

from followerd.errors import Stopped
from followerd.messages import Pixels
from followerd.sim.render import Draw, Shot
from followerd.sim.rig import Rig


@contextmanager
def darkroom(rig: Rig) -> Iterator[None]:
    """Until the end of the block another process draws what the rig's camera takes."""
    cv2.setNumThreads(1)  # a forked process would wait for threads that it has not got
    fork = multiprocessing.get_context("fork")
    ours, theirs = fork.Pipe()
    process = fork.Process(target=_draw_all, args=(rig.world.draw, theirs, ours), daemon=True)
    process.start()
    theirs.close()
    room = Darkroom(ours)
    rig.world.draw, rig.camera.develop = room.colour, room.finish
    try:
        yield
    finally:
        ours.close()
        process.join()


class Darkroom:
    """Takes shots and hands out blank pictures, which `finish` fills in."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._blank: deque[Pixels] = deque()

    def colour(self, shot: Shot, omega: float) -> Pixels:
        """As Renderer.colour, but blank until `finish`; raises Stopped."""
        picture = np.empty((shot.camera.height, shot.camera.width, 3), np.uint8)
        try:
            self._pipe.send((shot, omega))
        except OSError:
            raise _ended() from None
        self._blank.append(picture)
        return picture

    def finish(self) -> None:
        """Wait until every picture is drawn; raises Stopped."""
        while self._blank:
            try:
                self._pipe.recv_bytes_into(self._blank[0].reshape(-1))
            except (EOFError, OSError):
                raise _ended() from None
            self._blank.popleft()


def _draw_all(draw: Draw, pipe: Connection, other_end: Connection) -> None:
    """Draw one picture after another, until the other end is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever is interrupted closes it
    other_end.close()
    # a task that wakes up would else push the world off its core, and draw while that waits
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    with suppress(EOFError, ConnectionError):
        while True:
            pipe.send_bytes(draw(*pipe.recv()).tobytes())


def _ended() -> Stopped:
    return Stopped("the process that draws the pictures has ended; its own message stands above")
