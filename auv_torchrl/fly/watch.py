"""The second process: where the first one ends or hangs, it sends neutral, and what else leaves the vehicle as it was.

It is handed the bytes to send and knows nothing of vehicles or messages; it imports the standard library alone. The
first process says by when the vehicle must be neutral, after each command.
"""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from typing import Any, NoReturn, Protocol

NEUTRAL_S, EVERY_S = 1.0, 0.05  # s for which neutral is sent, and how often
START_S = 30.0  # s that the process may take to start, on a machine that is busy
TOOK_OVER = 3  # exit code


class Guard(Protocol):
    """Who sends neutral where this process ends."""

    def plan(self, neutral: bytes, ending: Sequence[bytes]) -> None:
        """What to send: neutral again and again, then the packets that leave the vehicle as it was."""
        ...

    def beat(self, until_s: float) -> None:
        """This process lives, and speaks again before ``until_s``."""
        ...

    def alive(self) -> bool:
        """Whether it is there."""
        ...


class Watcher:
    """Starts the second process on a socket that it shares with this one.

    Args:
        shared: the socket.
        peer: to whom is sent; None where the socket knows.

    Raises:
        RuntimeError: where it does not start.
    """

    def __init__(self, shared: socket.socket, peer: tuple[str, int] | None):
        reading, self._pipe = os.pipe()
        os.set_blocking(self._pipe, False)
        started, tell = os.pipe()
        given = json.dumps({"socket": shared.fileno(), "peer": peer, "pipe": reading, "started": tell})
        # A session of its own: Ctrl-C in the terminal is for the first process.
        self._process = subprocess.Popen(
            [sys.executable, "-I", "-S", __file__, given],
            start_new_session=True,
            pass_fds=(shared.fileno(), reading, tell),
        )
        os.close(reading)
        os.close(tell)
        ready, _, _ = select.select([started], [], [], START_S)
        begun = bool(ready) and os.read(started, 1) == b"s"
        os.close(started)
        if not begun:
            self._process.kill()
            raise RuntimeError("the second process, which watches the flight, did not start")

    def plan(self, neutral: bytes, ending: Sequence[bytes]) -> None:
        """What to send: neutral again and again, then the packets that leave the vehicle as it was."""
        self._tell({"neutral": neutral.hex(), "ending": [packet.hex() for packet in ending]})

    def beat(self, until_s: float) -> None:
        """This process lives, and speaks again before ``until_s``."""
        self._tell({"until": until_s})

    def alive(self) -> bool:
        """Whether it is there."""
        return self._process.poll() is None

    def close(self, done: bool) -> None:
        """Wait for its end; ``done`` says that the vehicle was left as it was, else it does that now."""
        if done:
            self._tell({"done": True})
        os.close(self._pipe)
        try:
            self._process.wait(START_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _tell(self, what: Any) -> None:
        try:
            os.write(self._pipe, json.dumps(what).encode() + b"\n")
        except (BlockingIOError, BrokenPipeError):  # it has ended or hangs: alive() says so, or it takes over
            return


class Watch:
    """What the second process does.

    Args:
        shared: socket to the vehicle.
        peer: to whom is sent; None where the socket knows.
        pipe: from the first process.
    """

    def __init__(self, shared: socket.socket, peer: tuple[str, int] | None, pipe: int):
        self._socket, self._peer, self._pipe = shared, peer, pipe
        self._parent = os.getppid()
        self._until = float("inf")
        self._neutral, self._ending = b"", []
        self._part = b""

    def run(self) -> bool:
        """Wait for the end of the flight; whether the first process did not get that far."""
        while True:
            wait = min(max(0.0, self._until - time.monotonic()), 1.0)
            ready, _, _ = select.select([self._pipe], [], [], wait)
            if ready:
                data = os.read(self._pipe, 65536)
                if data and self._heed(data):
                    return False
                if not data:
                    break
            elif time.monotonic() >= self._until:
                self._end_parent()
                break
        self._take_over()
        return True

    def _heed(self, data: bytes) -> bool:
        """Take what the first process says; whether the flight is over."""
        *lines, self._part = (self._part + data).split(b"\n")
        for line in lines:
            order = json.loads(line)
            if "done" in order:
                return True
            self._until = order.get("until", self._until)
            if "neutral" in order:
                self._neutral = bytes.fromhex(order["neutral"])
                self._ending = [bytes.fromhex(packet) for packet in order["ending"]]
        return False

    def _end_parent(self) -> None:
        """End the first process, which hangs: two must not fly."""
        if os.getppid() == self._parent:  # else it has ended, and its number may be that of another process
            os.kill(self._parent, signal.SIGKILL)

    def _take_over(self) -> None:
        """Send neutral, and then what leaves the vehicle as it was."""
        sys.stderr.write("fly: the flight's process ended or hung: neutral is sent in its place\n")
        end = time.monotonic() + NEUTRAL_S
        while self._neutral and time.monotonic() < end:
            self._send(self._neutral)
            time.sleep(EVERY_S)
        for packet in self._ending * 3:  # a packet may be lost
            self._send(packet)
            time.sleep(EVERY_S)

    def _send(self, packet: bytes) -> None:
        try:
            self._socket.sendto(packet, self._peer) if self._peer else self._socket.send(packet)
        except OSError:
            return  # the vehicle is out of reach: its own failsafes act


def main(given: dict[str, Any]) -> NoReturn:
    """Watch, and exit."""
    for signum in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(signum, signal.SIG_IGN)  # it ends when the first process has ended the flight
    os.write(given["started"], b"s")
    os.close(given["started"])
    shared = socket.socket(fileno=given["socket"])
    peer = tuple(given["peer"]) if given["peer"] else None
    sys.exit(TOOK_OVER if Watch(shared, peer, given["pipe"]).run() else 0)


if __name__ == "__main__":
    main(json.loads(sys.argv[1]))
