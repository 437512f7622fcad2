"""The conversation with one vehicle: what it says is kept, what is asked is asked again until it is answered."""

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from auv_torchrl.fly.connection import Link
from auv_torchrl.fly.known import ARMED
from auv_torchrl.fly.mavlink import Message, Parser, packet, text_of

AUTOPILOT, OURS = 1, 190  # numbers of components: the vehicle's autopilot, and ours, MAV_COMP_ID_MISSIONPLANNER
_NO_AUTOPILOT, _GROUND_STATION = 8, 6  # HEARTBEAT.autopilot, .type
ARM, INTERVAL, REQUEST = 400, 511, 512  # MAV_CMD
_VERSION = 148  # number of AUTOPILOT_VERSION
_TEXTS = 5  # of the vehicle that are kept
_AGAIN_S = 0.5  # s after which is asked again


class Heard(NamedTuple):
    """The last heartbeat."""

    kind: int
    autopilot: int
    mode: int
    armed: bool


class Talk:
    """Speaks with the vehicle at the other end.

    Args:
        link: to it.
        system: our number, that of a ground station which the vehicle obeys.
        silent: whether nothing is ever sent.
    """

    def __init__(self, link: Link, system: int, silent: bool):
        self.link, self.system, self.silent = link, system, silent
        self.vehicle: int | None = None  # its number
        self.others: set[int] = set()  # numbers of further vehicles
        self.heard: Heard | None = None
        self.version: tuple[int, int] | None = None
        self.parameters: dict[str, float] = {}
        self.named: dict[str, float] = {}  # NAMED_VALUE_FLOAT: PilotGain, InputHold, RollPitch
        self.results: dict[int, int] = {}  # of commands
        self.texts: list[str] = []
        self.sent = 0  # packets
        self._parser = Parser()
        self.hear: Callable[[Message, float], None] = lambda message, received: None  # is told of every message

    def listen(self, until_s: float) -> None:
        """Take in what comes until then."""
        while self.link.now() < until_s:
            self.take(self.link.receive(until_s))

    def take(self, data: bytes) -> None:
        """Take in bytes that came now."""
        received = self.link.now()
        for message in self._parser.feed(data):
            self._keep(message)
            self.hear(message, received)

    def _keep(self, message: Message) -> None:
        content = message.fields
        if message.name == "HEARTBEAT" and message.component == AUTOPILOT:
            if content["autopilot"] == _NO_AUTOPILOT or content["type"] == _GROUND_STATION:
                return
            self.vehicle = message.system if self.vehicle is None else self.vehicle
            if message.system == self.vehicle:
                armed = bool(content["base_mode"] & ARMED)
                self.heard = Heard(content["type"], content["autopilot"], content["custom_mode"], armed)
            else:
                self.others.add(message.system)
        if message.system != self.vehicle:
            return
        if message.name == "PARAM_VALUE":
            self.parameters[text_of(content["param_id"])] = content["param_value"]
        elif message.name == "AUTOPILOT_VERSION":
            self.version = content["flight_sw_version"] >> 24, (content["flight_sw_version"] >> 16) & 0xFF
        elif message.name == "NAMED_VALUE_FLOAT" and math.isfinite(content["value"]):
            self.named[text_of(content["name"])] = content["value"]
        elif message.name == "COMMAND_ACK":
            self.results[content["command"]] = content["result"]
        elif message.name == "STATUSTEXT":
            self.texts = [*self.texts, text_of(content["text"])][-_TEXTS:]

    def bytes_of(self, name: str, **fields: Any) -> bytes:
        """A message as it would be sent."""
        return packet(name, self.system, OURS, self.sent, **fields)

    def send(self, data: bytes) -> None:
        """Send a packet, unless nothing is sent."""
        if not self.silent:
            self.link.send(data)
            self.sent += 1

    def command(self, number: int, *parameters: float) -> bytes:
        """COMMAND_LONG to the vehicle's autopilot."""
        given: dict[str, Any] = {f"param{n}": value for n, value in enumerate(parameters, start=1)}
        return self.bytes_of(
            "COMMAND_LONG", command=number, target_system=self.vehicle, target_component=AUTOPILOT, **given
        )

    def mode(self, number: int) -> bytes:
        """SET_MODE."""
        return self.bytes_of("SET_MODE", custom_mode=number, target_system=self.vehicle, base_mode=1)

    def heartbeat(self) -> bytes:
        """Ours, as a ground station."""
        return self.bytes_of("HEARTBEAT", type=_GROUND_STATION, autopilot=_NO_AUTOPILOT, mavlink_version=3)

    def ask(self, questions: Callable[[], Iterator[bytes]], within_s: float) -> bool:
        """Send what is still asked again and again, until nothing is or the time is over; whether all was answered."""
        end = self.link.now() + within_s
        while open_questions := list(questions()):
            if self.link.now() >= end or self.link.lost:
                return False
            for question in open_questions:
                self.send(question)
            again = min(self.link.now() + _AGAIN_S, end)
            while self.link.now() < again and list(questions()):
                self.take(self.link.receive(again))
        return True

    def ask_parameters(self, names: tuple[str, ...], either: tuple[str, ...], within_s: float) -> bool:
        """Ask for the version, for parameters, and for one of ``either``; whether all came. They are kept."""

        def questions() -> Iterator[bytes]:
            if self.version is None:
                yield self.command(REQUEST, _VERSION)
            one_came = any(name in self.parameters for name in either)
            for name in (*names, *(() if one_came else either)):
                if name not in self.parameters:
                    yield self.bytes_of("PARAM_REQUEST_READ", param_index=-1, target_system=self.vehicle,
                                        target_component=AUTOPILOT, param_id=name.encode())  # fmt: skip

        return self.ask(questions, within_s)
