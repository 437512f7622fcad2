"""The UDP socket of the link, and the loop that answers one packet after the other."""

import errno
import logging
import select
import socket
import struct
import time
from collections.abc import Callable

from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.protocol import LARGEST_BYTES

log = logging.getLogger(__name__)

LOOK_S = 0.2  # s after which the loop looks whether it shall end, where no packet comes
BUFFER = LARGEST_BYTES + 1  # bytes: of a longer packet so much is read, which is none of ours
MOST_WAITING = 300  # packets that are read before an answer goes out: a buffer of Linux's default size holds fewer
# s that a repeated question waits for a newer one: it may have crossed its answer, and then the next question follows.
# A firmware asks again after about 1 s.
CROSSED_S = 0.05

Sender = tuple[str, int]


def open_socket(address: tuple[str, int]) -> socket.socket:
    """A socket that listens at an address; the caller closes it.

    Raises:
        ValueError: where that cannot be, with what to do.
    """
    listener = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    where = "{}:{}".format(*address)
    try:
        listener.bind(address)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise ValueError(
                f"bind={where} is used by another program: end it, or give another port and start ArduSub with "
                "--sim-port-out or another instance, -I1 for 9012"
            ) from error
        raise ValueError(
            f"cannot listen at bind={where} ({error.strerror}): give an address of this machine"
        ) from error
    # A timeout of the system: Python's own one asks before each packet whether there is any, 10 us.
    whole, part = divmod(round(LOOK_S * 1e6), 1_000_000)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", whole, part))
    return listener


def serve(
    listener: socket.socket, lockstep: Lockstep, ended: Callable[[], bool], after_packet: Callable[[], None]
) -> None:
    """Answer packets until ``ended``, which is asked after each answer and every :data:`LOOK_S`.

    ArduSub takes whatever comes for the answer to its last question. With one answer too many it would read old ones
    from then on, so each question has one answer at most: all packets that wait are handed to the lock-step, those
    included that came while it stepped, and the newest question alone is answered.
    """
    sent: tuple[bytes, Sender] | None = None
    while not ended():
        received = _receive(listener)
        if received is not None and (reply := _newest_reply(listener, lockstep, received, sent)) is not None:
            _send(listener, *reply)
            sent = reply
        after_packet()


def _newest_reply(
    listener: socket.socket, lockstep: Lockstep, received: tuple[bytes, Sender], sent: tuple[bytes, Sender] | None
) -> tuple[bytes, Sender] | None:
    """The answer to the newest of a received packet and those that wait behind it; None where none asks anything."""
    reply, patience = None, CROSSED_S
    waiting: tuple[bytes, Sender] | None = received
    for _ in range(MOST_WAITING):
        if waiting is None:
            break
        packet, sender = waiting
        if (line := lockstep.answer(packet, sender)) is not None:
            reply = line, sender
        repeated = reply is not None and reply == sent
        waiting = _waiting(listener, patience if repeated else 0.0)
        patience = 0.0 if repeated else patience
    return reply


def _receive(listener: socket.socket) -> tuple[bytes, Sender] | None:
    """The next packet; None where none comes for :data:`LOOK_S`."""
    try:
        return listener.recvfrom(BUFFER)
    except BlockingIOError:  # the timeout of the system
        return None


def _waiting(listener: socket.socket, wait_s: float) -> tuple[bytes, Sender] | None:
    """A packet that is here, or comes within ``wait_s``."""
    if wait_s > 0:
        select.select([listener], [], [], wait_s)
    try:
        return listener.recvfrom(BUFFER, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None


def _send(listener: socket.socket, line: bytes, sender: Sender) -> None:
    try:
        listener.sendto(line, sender)
    except OSError as error:  # no way to the sender, or a sender without port: as if the packet were lost on its way
        log.warning("cannot answer %s:%d (%s): it has to ask again", *sender, error.strerror)


class Pace:
    """How fast simulated time goes by, on the wall clock.

    Args:
        clock: in s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._at_s, self._flown_s = clock(), 0.0
        self.times_real = 0.0

    def look(self, flown_s: float, every_s: float = 1.0) -> bool:
        """Measure anew where ``every_s`` has gone by since; ``flown_s`` is all simulated time so far."""
        passed = self._clock() - self._at_s
        if passed < every_s:
            return False
        self.times_real = (flown_s - self._flown_s) / passed
        self._at_s, self._flown_s = self._at_s + passed, flown_s
        return True
