"""What is ArduPilot's own: names that it gives by number, and the lanes of its filter, of which one is in use."""

from collections.abc import Iterable, Mapping

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.readers.messages import Columns, Messages, whole_numbers
from auv_torchrl.flightlog.streams.parameters import read_parameters
from auv_torchrl.flightlog.streams.stream import Kind, VehicleFacts
from auv_torchrl.flightlog.streams.vehicle_kind import kind_of_text, other_kind

_MODES = {  # https://ardupilot.org/sub/docs/ardusub-flight-modes.html
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE", 16: "POSHOLD",
    19: "MANUAL", 20: "MOTOR_DETECT", 21: "SURFTRAK",
}  # fmt: skip
_FRAMES: dict[float, tuple[str, int | None]] = {  # FRAME_CONFIG: name and motors; a custom frame (7) may have any
    0: ("bluerov1", 6), 1: ("vectored", 6), 2: ("vectored_6dof", 8), 3: ("vectored_6dof_90deg", 8),
    4: ("simplerov_3", 3), 5: ("simplerov_4", 4), 6: ("simplerov_5", 5), 7: ("custom", None),
}  # fmt: skip
_MOST_TEXTS = 10_000  # among which the firmware names itself; it does so when it starts
_VELOCITY_KNOWN = 1 << 1  # of XKF4.SS and EKF_STATUS_REPORT.flags: horizontal velocity,
_POSITION_KNOWN = (1 << 3) | (1 << 4)  # relative, absolute; https://mavlink.io/en/messages/ardupilotmega.html
_STANDS_STILL = 1 << 7  # constant position mode: the filter has no position and says 0


def vehicle_facts(
    name: str, messages: Messages, parameter: tuple[str, str, str], text: tuple[str, str], kinds: Iterable[Kind] = ()
) -> tuple[VehicleFacts, tuple[Finding, ...]]:
    """What a log says of its vehicle, in messages of the types, with the fields, of a parameter and of a text.

    Args:
        name: of the file.
        messages: of the log.
        parameter: message, and its fields with name and value of a parameter.
        text: message, and its field with a text of the firmware.
        kinds: of vehicle that the log names elsewhere.
    """
    given, lines = messages.get(*parameter), messages.get(*text)
    named = [] if given is None else zip(map(spelt, given[parameter[1]]), given[parameter[2]].tolist(), strict=True)
    parameters, findings = read_parameters(name, named)
    texts = [] if lines is None else list(dict.fromkeys(map(spelt, lines[text[1]][:_MOST_TEXTS])))
    source = f"text of the firmware, {text[0]}"
    kind = next(((spoken, of) for spoken in texts if (of := kind_of_text(spoken, source)) is not None), None)
    firmware = kind[0] if kind else next((spoken for spoken in texts if spoken.startswith("Ardu")), "")
    every = (*((kind[1],) if kind else ()), *kinds)
    frame = ("", None) if other_kind(every) else _frame_of(parameters)
    return VehicleFacts(firmware, *frame, parameters, every), findings


def spelt(value: bytes | str) -> str:
    """A text as a log has it, in letters, up to its first zero."""
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).partition("\0")[0]


def mode_name(vehicle: VehicleFacts, number: int) -> str:
    """The name of a mode, or its number where the vehicle is another one, whose numbers mean other modes."""
    number = int(number)
    return f"MODE_{number}" if other_kind(vehicle.kinds) else _MODES.get(number, f"MODE_{number}")


def _frame_of(parameters: Mapping[str, float]) -> tuple[str, int | None]:
    """Name and number of motors of the frame; empty and None where the parameters do not say."""
    number = parameters.get("FRAME_CONFIG")
    return ("", None) if number is None else _FRAMES.get(number, (f"frame {number:g}", None))


def primary_lane(messages: Messages) -> tuple[Columns | None, int, list[Finding]]:
    """XKF4 of the lane in use at each time, the lane that was in use longest, and where it was exchanged."""
    status = messages.get("XKF4", "SS", "PI")
    if status is None:
        return None, 0, []
    kept = rows(status, status["C"] == status["PI"]) if "C" in status else status
    lane = int(np.bincount(whole_numbers(status["PI"]).clip(0, 255)).argmax())
    switches = np.flatnonzero(np.diff(whole_numbers(kept["PI"]))) + 1
    findings = []
    if len(switches):
        at = ", ".join(f"{kept['t'][i]:.1f} s" for i in switches[:3]) + (", ..." if len(switches) > 3 else "")
        sentence = f"the filter changed its lane at {at}; what it estimates may leap there"
        findings.append(Finding(Severity.WARNING, "lane_switch", sentence, "Look for the sensor that it gave up"))
    return kept if len(kept["t"]) else None, lane, findings


def of_lane(columns: Columns, primary: Columns | None, lane: int) -> Columns:
    """The rows of the lane that was in use at their times."""
    if "C" not in columns:
        return columns
    if primary is None:
        return rows(columns, columns["C"] == lane)
    return rows(columns, columns["C"] == primary["PI"][latest(primary["t"], columns["t"])])


def leave_out_unknown(place: np.ndarray, speed: np.ndarray, t: np.ndarray, status: Columns | None, field: str) -> None:
    """Make NaN, of positions and velocities (T, 3) in NED, what a filter does not know by its flags at those times.

    Without ``status`` it does not say what it knows along the horizontal.
    """
    if status is None:
        place[:, :2] = speed[:, :2] = np.nan
        return
    flags = whole_numbers(status[field])[latest(status["t"], t)]
    moves = (flags & _STANDS_STILL) == 0
    place[~(((flags & _POSITION_KNOWN) != 0) & moves), :2] = np.nan
    speed[~(((flags & _VELOCITY_KNOWN) != 0) & moves), :2] = np.nan


def latest(known: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Rows of ``known`` that were the latest at ``t``, or the first."""
    return np.maximum(np.searchsorted(known, t + 1e-6, side="right") - 1, 0)


def rows(columns: Columns, kept: np.ndarray) -> Columns:
    """The messages that a mask (T,) keeps."""
    return {name: values[kept] for name, values in columns.items()}
