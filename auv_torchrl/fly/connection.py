"""The connection to a vehicle: bytes both ways over TCP or UDP, never waiting for the other side when it sends."""

import errno
import fcntl
import select
import socket
import struct
import termios
import time
from typing import NamedTuple, Protocol

_BLOCK = 65536  # bytes read at once
_PACKET = 40  # bytes of one command, about
# Bytes that the vehicle has not taken yet: commands in them arrive late, so that not more than 0.3 s of them may wait.
MOST_UNSENT = 6 * _PACKET
_CONNECT_S = 10.0
KINDS = ("tcp", "udpin", "udpout")


class Place(NamedTuple):
    """Where a vehicle is reached."""

    kind: str
    host: str
    port: int


class Link(Protocol):
    """What a flight needs of a connection."""

    lost: bool  # whether the other side has closed it

    def now(self) -> float:
        """Time in s, on a clock that never steps back."""
        ...

    def receive(self, until_s: float) -> bytes:
        """What has come; waits for it until ``until_s``, and gives nothing then."""
        ...

    def send(self, data: bytes) -> None:
        """Send a packet, or nothing of it where the other side takes no more."""
        ...

    def blocked(self) -> bool:
        """Whether the other side has not taken what was sent before."""
        ...


def parse_place(connection: str, elsewhere: bool) -> Place:
    """Where ``tcp:127.0.0.1:5760`` is.

    Args:
        connection: as it was given.
        elsewhere: whether ``udpin`` may listen at an address that other machines reach.

    Raises:
        ValueError: for one that is none, or that others reach although nobody said so.
    """
    kind, _, rest = connection.partition(":")
    host, colon, port = rest.rpartition(":")
    kind = {"udp": "udpin"}.get(kind, kind)
    if kind not in KINDS or not host or not colon or not (port.isascii() and port.isdigit()) or int(port) > 65535:
        raise ValueError(
            f"connection={connection} is none: give one like tcp:127.0.0.1:5760, udpin:127.0.0.1:14550 (the vehicle "
            "sends there) or udpout:192.168.2.2:14550"
        )
    if kind == "udpin" and not (host.startswith("127.") or host == "localhost") and not elsewhere:
        raise ValueError(
            f"connection={connection} is reached by other machines, and whoever sends packets there can say where the "
            "vehicle is: give udpin:127.0.0.1:14550, or elsewhere=true as well"
        )
    return Place(kind, host, int(port))


def _open(place: Place) -> socket.socket:
    where = f"{place.host}:{place.port}"
    try:
        if place.kind == "tcp":
            return socket.create_connection((place.host, place.port), _CONNECT_S)
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        (made.bind if place.kind == "udpin" else made.connect)((place.host, place.port))
        return made
    except OSError as error:
        what = "used by another program" if error.errno == errno.EADDRINUSE else (error.strerror or error)
        raise ValueError(
            f"connection={place.kind}:{where} cannot be opened ({what}): start the vehicle, or look at address and port"
        ) from error


class Connection:
    """A socket to a vehicle; the caller closes it.

    Args:
        place: where the vehicle is reached.

    Raises:
        ValueError: where nobody is reached, with what to do.
    """

    def __init__(self, place: Place):
        self.kind = place.kind
        self.lost = False
        self.peer: tuple[str, int] | None = None  # who sends to udpin: the first one
        self.socket = _open(place)
        self.socket.setblocking(False)
        if self.kind == "tcp":
            self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def now(self) -> float:
        """Time in s, the same clock in all processes of the machine."""
        return time.monotonic()

    def receive(self, until_s: float) -> bytes:
        """What has come; waits for it until ``until_s``, and gives nothing then."""
        while True:
            wait = max(0.0, until_s - self.now())
            if self.lost:
                time.sleep(wait)
                return b""
            ready, _, _ = select.select([self.socket], [], [], wait)
            if not ready:
                return b""
            if data := self._read():
                return data

    def _read(self) -> bytes:
        try:
            data, sender = self.socket.recvfrom(_BLOCK)
        except BlockingIOError:
            return b""
        except OSError:
            self.lost = self.kind == "tcp"  # UDP: nobody listened to what was sent; the vehicle may still start
            return b""
        if self.kind == "tcp":
            self.lost = not data
            return data
        if self.kind == "udpin":
            self.peer = self.peer or sender
            return data if sender == self.peer else b""
        return data

    def send(self, data: bytes) -> None:
        """Send a packet, or nothing of it where the other side takes no more."""
        if self.lost or (self.kind == "udpin" and self.peer is None):
            return
        try:
            if self.kind == "udpin":
                assert self.peer is not None
                self.socket.sendto(data, self.peer)
            else:
                self.socket.send(data)
        except BlockingIOError:
            return
        except OSError:
            self.lost = self.kind == "tcp"

    def blocked(self) -> bool:
        """Whether the other side has not taken what was sent before."""
        if self.lost:
            return True
        if self.kind != "tcp":
            return False
        (waiting,) = struct.unpack("i", fcntl.ioctl(self.socket.fileno(), termios.TIOCOUTQ, b"\0" * 4))
        return waiting > MOST_UNSENT

    def close(self) -> None:
        """Close it."""
        self.socket.close()
