"""A stand-in for the firmware's side of ArduPilot's JSON interface: strict ping-pong, as ``SIM_JSON`` does it.

It reads the answer as ArduSub does, by looking for text, not as JSON. It has none of ArduSub's estimates or control:
its outputs are what a test gives it.
"""

import re
import socket
from collections.abc import Sequence
from typing import NamedTuple

from auv_torchrl.link.protocol import Servos, servo_packet

NEUTRAL = (1500,) * 16
PATIENT_S = 120.0  # a firmware waits without end: this long a physics that answers at all may take on a busy machine
_NUMBER = r"\s*([-+0-9.e]+)\s*"
_WIDTHS = {"gyro": 3, "accel_body": 3, "position": 3, "velocity": 3, "quaternion": 4}


class Told(NamedTuple):
    """What an answer says."""

    timestamp: float
    gyro: tuple[float, ...]
    accel_body: tuple[float, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    quaternion: tuple[float, ...]


def read_answer(line: bytes) -> Told:
    """What ArduSub takes from an answer; an error where it would not."""
    text = line.decode("ascii")
    assert text[0] == "\n" and text[-1] == "\n" and text.count("\n") == 2 and len(line) < 65_000
    text = text[1:-1]
    timestamp = float(text[text.index("timestamp") + len("timestamp") + 2 :].split(",")[0])
    found = {}
    for key, width in _WIDTHS.items():
        inside = text[text.index('"imu"') :] if key in ("gyro", "accel_body") else text
        value = inside[inside.index(key) + len(key) + 2 :]  # behind the key, its quotation mark and the colon
        match = re.match(r"\[" + ",".join([_NUMBER] * width) + r"\]", value)
        assert match is not None, f"{key} is not read: {value[:40]}"
        found[key] = tuple(map(float, match.groups()))
    return Told(timestamp, **found)


class Firmware:
    """One process of ArduSub, on a socket of its own.

    Args:
        address: of the physics.
        rate_hz: the step that it would like.
        timeout_s: after which it asks again; ArduSub does so after 1 s.
    """

    def __init__(self, address: tuple[str, int], rate_hz: int = 400, timeout_s: float = 1.0):
        self.rate_hz, self.frame, self.asked_again = rate_hz, 0, 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._timeout_s = timeout_s
        self._address = address

    def send(self, pwm: Sequence[int] = NEUTRAL) -> None:
        """Send the servos of the frame that is next."""
        self._socket.sendto(servo_packet(Servos(self.rate_hz, self.frame, tuple(pwm))), self._address)

    def send_bytes(self, packet: bytes) -> None:
        """Send anything."""
        self._socket.sendto(packet, self._address)

    def receive(self) -> bytes:
        """The next answer, however late; it is accepted, and the next frame is next."""
        return self._accept(PATIENT_S)

    def look(self) -> bytes:
        """The next answer, when it is here; it stays unread."""
        self._socket.settimeout(PATIENT_S)
        return self._socket.recv(65_000, socket.MSG_PEEK)

    def _accept(self, wait_s: float) -> bytes:
        self._socket.settimeout(wait_s)
        line = self._socket.recv(65_000)
        self.frame += 1
        return line

    def exchange(self, pwm: Sequence[int] = NEUTRAL, tries: int = 100) -> bytes:
        """Send, wait for the answer, and ask again until there is one."""
        for _ in range(tries):
            self.send(pwm)
            try:
                return self._accept(self._timeout_s)
            except TimeoutError:
                self.asked_again += 1
        raise TimeoutError(f"no answer to frame {self.frame}")

    def nothing_comes(self, wait_s: float = 0.2) -> bool:
        """Whether no answer waits."""
        self._socket.settimeout(wait_s)
        try:
            self._socket.recv(65_000)
        except TimeoutError:
            return True
        return False

    def close(self) -> None:
        """End the process."""
        self._socket.close()
