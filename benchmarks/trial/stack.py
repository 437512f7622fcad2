"""Firmware and physics in lock-step, with a pilot whose clock is that of the simulation.

Simulated time goes on only while the pilot waits, so that no pilot is late however slow the machine is. The firmware's
noise and threads make each flight another one all the same.
"""

import socket
from collections.abc import Mapping
from pathlib import Path

from auv_torchrl.link.lockstep import Lockstep, Observer
from auv_torchrl.link.plant import Plant
from auv_torchrl.link.protocol import LARGEST_BYTES
from benchmarks.trial.firmware import RATE_HZ, Firmware
from benchmarks.trial.recorded import Recorder

_PATIENT_S = 60.0  # of the wall clock, without a packet of the firmware
_LOOK_EVERY = RATE_HZ // 50  # frames between looks at what the firmware says
_ROOM = 1 << 20  # bytes of MAVLink that may wait
_BLOCK = 65536


class FirmwareEnded(RuntimeError):
    """The firmware ended, or asks for nothing any more."""


class Stack:
    """A connection (``fly.connection.Link``) to a firmware that flies a plant.

    Args:
        plant: the vehicle.
        folder: of the firmware.
        parameters: of the firmware, where the folder is new.
        outputs: for each thruster the output that drives it; None for output n of thruster n.
        observers: who follow the flight.
        recorder: who keeps what goes both ways.
    """

    def __init__(
        self,
        plant: Plant,
        folder: Path,
        parameters: Mapping[str, float],
        outputs: tuple[int, ...] | None = None,
        observers: tuple[Observer, ...] = (),
        recorder: Recorder | None = None,
    ):
        self.plant, self.lost, self._recorder = plant, False, recorder
        outputs = outputs or tuple(range(1, plant.vehicle.thrusters + 1))
        self.lockstep = Lockstep(plant, outputs, paced=False, observers=observers)
        self._physics, self._ground = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        for own in (self._physics, self._ground):
            own.bind(("127.0.0.1", 0))
        self._ground.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _ROOM)
        self._ground.setblocking(False)
        self._physics.settimeout(1.0)
        self._peer: tuple[str, int] | None = None
        ports = self._physics.getsockname()[1], self._ground.getsockname()[1]
        try:
            self.firmware = Firmware(folder, *ports, parameters)
        except BaseException:
            self._close_sockets()
            raise

    def now(self) -> float:
        """Simulated time, s."""
        return self.plant.moment.time_s

    def receive(self, until_s: float) -> bytes:
        """What the firmware says; lets simulated time go on until it says something or ``until_s`` is there."""
        while self.now() < until_s:
            for _ in range(_LOOK_EVERY):
                self._answer()
            if data := self._heard():
                return data
        return self._heard()

    def send(self, data: bytes) -> None:
        """Send a packet to the firmware."""
        if self._peer is not None:
            self._ground.sendto(data, self._peer)

    def blocked(self) -> bool:
        """Whether the firmware takes nothing: never, over UDP."""
        return False

    def close(self) -> None:
        """End the firmware."""
        self.firmware.close()
        self._close_sockets()

    def _close_sockets(self) -> None:
        self._physics.close()
        self._ground.close()

    def _answer(self) -> None:
        waited = 0.0
        while True:
            try:
                packet, sender = self._physics.recvfrom(LARGEST_BYTES + 1)
                break
            except TimeoutError:
                waited += 1.0
                if self.firmware.ended is not None or waited > _PATIENT_S:
                    raise FirmwareEnded(f"{self.firmware.folder}: exit status {self.firmware.ended}") from None
        if (line := self.lockstep.answer(packet, sender)) is not None:
            self._physics.sendto(line, sender)
            if self._recorder is not None:
                self._recorder.add(packet, self.plant.reading())

    def _heard(self) -> bytes:
        data = b""
        while True:
            try:
                part, self._peer = self._ground.recvfrom(_BLOCK)
            except BlockingIOError:
                return data
            data += part
