"""The UDP socket of the link, and the loop that answers one packet after the other."""

import errno
import logging
import socket
import struct
import time
from collections.abc import Callable

from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.protocol import LARGEST_BYTES

log = logging.getLogger(__name__)

LOOK_S = 0.2  # s after which the loop looks whether it shall end, where no packet comes
BUFFER = LARGEST_BYTES + 1  # bytes: of a longer packet so much is read, which is none of ours


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
    """Answer packets until ``ended``, which is asked after each packet and every :data:`LOOK_S`.

    Of a packet that waits several times, sent again while this process slept, the last one alone is answered: with more
    answers than questions the firmware would read old ones from then on.
    """
    before: tuple[bytes, tuple[str, int]] | None = None
    while not ended():
        try:
            received = listener.recvfrom(BUFFER)
            while received == before and (waiting := _waiting(listener)) is not None:
                received = waiting
        except BlockingIOError:  # the timeout
            after_packet()
            continue
        before = received
        packet, sender = received
        if (line := lockstep.answer(packet, sender)) is not None:
            _send(listener, line, sender)
        after_packet()


def _waiting(listener: socket.socket) -> tuple[bytes, tuple[str, int]] | None:
    try:
        return listener.recvfrom(BUFFER, socket.MSG_DONTWAIT)
    except BlockingIOError:
        return None


def _send(listener: socket.socket, line: bytes, sender: tuple[str, int]) -> None:
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
