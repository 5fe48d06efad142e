"""The last resort: a tiny process of its own that can only stop the base.

It holds a copy of the base's open port and listens for the loop's heartbeat. When that falls
silent (a blocked loop, a call that holds the interpreter's lock, SIGSTOP), or the daemon is gone
(SIGKILL), it writes STOP, VEL 0, RVEL 0 a few times, then keeps quiet: only what the guard approved
may hold off the firmware's own watchdog.

Run as a script by `beside`, with nothing but the standard library: it starts in 30 ms.
"""

import json
import os
import select
import socket
import sys
import time

LATE = 0.25  # s without a heartbeat
STOPS = 3  # a lost one must not be the only one
APART = 0.1  # s, between them
LONGEST = 64  # bytes of a message


def main(number: int) -> None:
    """Watch over what comes through the socket of that file descriptor, until it closes."""
    channel = socket.socket(fileno=number)
    port, halt, beaten = -1, b"", time.monotonic()  # noqa: TID251 no loop here
    watched = select.poll()
    watched.register(channel, select.POLLIN)
    while True:
        ready = {fd for fd, _ in watched.poll(200.0 * LATE)}
        if port in ready:  # it hung up; what is plugged in next shall get its number
            port = let_go(port, watched)
        if number in ready:
            message, ports, _, _ = socket.recv_fds(channel, LONGEST, 1)
            if not message:
                break
            beaten = time.monotonic()  # noqa: TID251
            if ports:
                if port >= 0:
                    let_go(port, watched)
                port, halt = ports[0], message
                watched.register(port, 0)  # a hang-up is always told
        elif port >= 0 and time.monotonic() - beaten > LATE:  # noqa: TID251
            stop(port, halt, "the loop is blocked")
            # the next message is a sign of life; until then nothing more is written
            select.select([channel], [], [])
            beaten = time.monotonic()  # noqa: TID251
    if port >= 0:
        stop(port, halt, "the daemon is gone")


def let_go(port: int, watched: select.poll) -> int:
    """Close the copy; -1."""
    watched.unregister(port)
    os.close(port)
    return -1


def stop(port: int, halt: bytes, why: str) -> None:
    """Write `halt` a few times; a port that is gone cannot be helped."""
    print(json.dumps({"event": "last resort: stop", "level": "error", "why": why}), file=sys.stderr)  # noqa: T201 the journal
    for _ in range(STOPS):
        try:
            os.write(port, halt)
        except OSError:
            return
        time.sleep(APART)  # noqa: TID251


if __name__ == "__main__":
    main(int(sys.argv[1]))
