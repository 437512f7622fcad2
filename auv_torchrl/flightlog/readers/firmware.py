"""Names that ArduPilot gives by number: modes and frames of ArduSub, and what a motor output is."""

from collections.abc import Mapping

from auv_torchrl.flightlog.readers.messages import Messages
from auv_torchrl.flightlog.streams.stream import VehicleFacts

_MODES = {  # https://ardupilot.org/sub/docs/ardusub-flight-modes.html
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE", 16: "POSHOLD",
    19: "MANUAL", 20: "MOTOR_DETECT", 21: "SURFTRAK",
}  # fmt: skip
_FRAMES = {  # FRAME_CONFIG of ArduSub: name and number of motors; a custom frame (7) may have any
    0: ("bluerov1", 6), 1: ("vectored", 6), 2: ("vectored_6dof", 8), 3: ("vectored_6dof_90deg", 8),
    4: ("simplerov_3", 3), 5: ("simplerov_4", 4), 6: ("simplerov_5", 5), 7: ("custom", None),
}  # fmt: skip
SUB = "ArduSub"


def vehicle_facts(messages: Messages, parameter: tuple[str, str, str], text: tuple[str, str]) -> VehicleFacts:
    """What a log says of its vehicle, in messages of the types, with the fields, of a parameter and of a text."""
    given, said = messages.get(*parameter), messages.get(*text)
    named = () if given is None else zip(given[parameter[1]], given[parameter[2]], strict=True)
    parameters = {spelt(name): float(value) for name, value in named}
    texts = () if said is None else map(spelt, said[text[1]])
    firmware = next((told for told in texts if told.startswith("Ardu")), "")
    return VehicleFacts(firmware, *frame_of(firmware, parameters), parameters)


def spelt(value: bytes | str) -> str:
    """A text as a log has it, in letters."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def mode_name(firmware: str, number: float) -> str:
    """The name of a mode, or its number where the firmware is no ArduSub that says so."""
    number = int(number)
    if firmware and not firmware.startswith(SUB):
        return f"MODE_{number}"  # numbers mean other modes there
    return _MODES.get(number, f"MODE_{number}")


def frame_of(firmware: str, parameters: Mapping[str, float]) -> tuple[str, int | None]:
    """Name and number of motors of the frame; empty and None where the log does not say."""
    number = parameters.get("FRAME_CONFIG")
    if number is None or (firmware and not firmware.startswith(SUB)):
        return "", None
    return _FRAMES.get(int(number), (f"frame {int(number)}", None))
