"""Pictures drawn in a process of their own, while their world goes on.

A picture follows from its shot and from the pictures before it, so it is the same wherever it is
drawn; and it is not looked at before the camera has been read out. In virtual time a run on its
own thus uses a second core for the quarter of its work that can wait so long.
"""

import multiprocessing
import os
import pickle
import signal
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import cycle
from mmap import mmap
from multiprocessing.connection import Connection
from struct import Struct

import cv2
import numpy as np

from followerd.errors import Stopped
from followerd.geometry import Camera, Pose2
from followerd.messages import Pixels
from followerd.sim.render import Draw, Shot
from followerd.sim.rig import Rig

# an order: pose of the robot, time and turn rate, then the camera if it looks otherwise than before
ORDER = Struct("5d")
DRAWN = b"\0"  # the answer
MOST = 4  # pictures that are not fetched yet


@contextmanager
def darkroom(rig: Rig) -> Iterator[None]:
    """Until the end of the block another process draws what the rig's camera takes."""
    cv2.setNumThreads(1)  # a forked process would wait for threads that it has not got
    fork = multiprocessing.get_context("fork")
    # two pipes, not a pair of sockets: measured, whoever waits for the other goes on sooner
    orders, order = fork.Pipe(duplex=False)
    drawn, answer = fork.Pipe(duplex=False)
    prints = _shared_pictures(MOST, rig.camera.layout.height, rig.camera.layout.width)
    process = fork.Process(
        target=_draw_all,
        args=(rig.world.paint, prints, orders, answer, (order, drawn)),
        daemon=True,
    )
    process.start()
    orders.close()
    answer.close()
    room = Darkroom(order, drawn, prints)
    rig.world.draw, rig.camera.develop = room.colour, room.finish
    try:
        yield
    finally:
        order.close()
        process.join()
        drawn.close()


def _shared_pictures(count: int, height: int, width: int) -> Pixels:
    """Blank pictures (count, height, width, 3) in memory that a forked process has too."""
    memory = mmap(-1, count * height * width * 3)
    return np.frombuffer(memory, np.uint8).reshape(count, height, width, 3)


class Darkroom:
    """Takes shots and hands out blank pictures, which `finish` fills in."""

    def __init__(self, order: Connection, drawn: Connection, prints: Pixels) -> None:
        """`order` takes what is to be drawn, `drawn` tells of each picture that is."""
        self._order, self._drawn = order, drawn
        self._prints = cycle(prints)
        self._blank: deque[Pixels] = deque()
        self._camera: Camera | None = None  # of the last order

    def colour(self, shot: Shot, omega: float) -> Pixels:
        """As Renderer.colour, but blank until `finish`; raises Stopped."""
        if len(self._blank) == MOST:
            self.finish()
        pose, camera = shot.pose, shot.camera
        order = ORDER.pack(pose.x, pose.y, pose.theta, shot.time, omega)
        if camera is not self._camera:
            order += pickle.dumps(camera)
            self._camera = camera
        try:
            self._order.send_bytes(order)
        except OSError:
            raise _ended() from None
        picture = np.empty((camera.height, camera.width, 3), np.uint8)
        self._blank.append(picture)
        return picture

    def finish(self) -> None:
        """Wait until every picture is drawn; raises Stopped."""
        while self._blank:
            try:
                self._drawn.recv_bytes()
            except (EOFError, OSError):
                raise _ended() from None
            self._blank.popleft()[:] = next(self._prints)


def _draw_all(
    paint: Callable[[], Draw],
    prints: Pixels,
    orders: Connection,
    drawn: Connection,
    other_ends: tuple[Connection, ...],
) -> None:
    """Draw one picture after another, until the other ends are closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever is interrupted closes them
    for end in other_ends:
        end.close()
    # a task that wakes up would else push the world off its core, and draw while that waits
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    draw = paint()
    with suppress(EOFError, ConnectionError):
        for picture in cycle(prints):
            order = orders.recv_bytes()
            if camera_bytes := order[ORDER.size :]:
                camera: Camera = pickle.loads(camera_bytes)
            x, y, theta, time, omega = ORDER.unpack_from(order)
            picture[:] = draw(Shot(camera, Pose2(x, y, theta), time), omega)
            drawn.send_bytes(DRAWN)


def _ended() -> Stopped:
    return Stopped("the process that draws the pictures has ended; its own message stands above")
