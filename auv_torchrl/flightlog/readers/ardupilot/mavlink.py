"""What MAVLink messages of an ArduPilot vehicle mean, wherever they were recorded: https://mavlink.io/en/messages/."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.ardupilot.firmware import leave_out_unknown, mode_name, vehicle_facts
from auv_torchrl.flightlog.readers.bounds import MOST_TEXTS, Budget, Loss, Rows
from auv_torchrl.flightlog.readers.messages import AT, Messages, changes, in_order, stacked, whole_numbers
from auv_torchrl.flightlog.streams.stream import (
    Kind,
    Sampling,
    Stream,
    Streams,
    VehicleFacts,
    by_name,
    state_of,
    stream,
)
from auv_torchrl.flightlog.streams.vehicle_kind import kind_of_type
from auv_torchrl.text import MOST_CHARACTERS

_SERVOS = tuple(f"servo{n}_raw" for n in range(1, 17))
_PRESSURES = ("SCALED_PRESSURE", "SCALED_PRESSURE2", "SCALED_PRESSURE3")
WANTED = {
    "HEARTBEAT": ("type", "autopilot", "base_mode", "custom_mode"),
    "PARAM_VALUE": ("param_id", "param_value"),
    "STATUSTEXT": ("text",),
    "SERVO_OUTPUT_RAW": ("time_usec", "port", *_SERVOS),
    "ATTITUDE": ("time_boot_ms", "roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed"),
    "RAW_IMU": ("time_usec", "xacc", "yacc", "zacc"),
    **{name: ("time_boot_ms", "xacc", "yacc", "zacc") for name in ("SCALED_IMU", "SCALED_IMU2")},
    "LOCAL_POSITION_NED": ("time_boot_ms", "x", "y", "z", "vx", "vy", "vz"),
    "GLOBAL_POSITION_INT": ("time_boot_ms", "relative_alt"),
    "EKF_STATUS_REPORT": ("flags",),
    "SYS_STATUS": ("voltage_battery", "current_battery"),
    **{name: ("time_boot_ms", "press_abs") for name in _PRESSURES},
}
ADDED = {"SERVO_OUTPUT_RAW": _SERVOS[8:]}  # fields of MAVLink 2 that an older message lacks: 0, no output
TEXTS = ("param_id", "text")  # fields that are no number; a message has one at most
COUNTS = (  # whole numbers
    "type", "autopilot", "base_mode", "custom_mode", "port", "flags", "time_usec", "time_boot_ms",
)  # fmt: skip
AUTOPILOT = 1  # number of the component that flies
_NO_AUTOPILOT, _GROUND_STATION = 8, 6  # HEARTBEAT.autopilot, .type
_MOST_KINDS = 3  # that are named; one vehicle has one, besides "generic" while it starts
_ARMED = 128  # of HEARTBEAT.base_mode
_G = 9.80665e-3  # m/s^2 for each mG of RAW_IMU and SCALED_IMU
_PA_A_METRE = 9800.0  # Pa/m, by which AP_Baro makes a depth of a pressure in water of specific gravity 1
_SAME_M = 0.25  # m, median by which a barometer outside differs from the depth in use
_RESTART_S = 1.0  # a boot time that steps back further is that of another start
_WRAP_S = 2**32 * 1e-6  # s, after which the 32 bits of SERVO_OUTPUT_RAW.time_usec begin anew


def _choose_vehicle(name: str, heard: Iterable[tuple[int, int, int]], system: int | None) -> int:
    """The number of the vehicle, out of heartbeats (system, type, autopilot).

    Raises:
        FlightLogError: if there are several and none was chosen, or none of that number.
    """
    vehicles = sorted({s for s, kind, pilot in heard if pilot != _NO_AUTOPILOT and kind != _GROUND_STATION})
    listed = ", ".join(map(str, vehicles)) or "none"
    if system is not None:
        if system not in vehicles:
            raise FlightLogError(f"{name} has no vehicle {system}: there are {listed}")
        return system
    if not vehicles:
        raise FlightLogError(f"{name} has no heartbeat of a vehicle: record on the link to its autopilot")
    if len(vehicles) > 1:
        raise FlightLogError(f"{name} has several vehicles, {listed}: choose one, such as system={vehicles[0]}")
    return vehicles[0]


def _streams_of(name: str, kind: str, messages: Messages) -> Streams:
    """The streams of one vehicle whose messages have the fields of :data:`WANTED`, times in s."""
    beat = messages.get("HEARTBEAT", "type", "base_mode", "custom_mode")
    kinds = () if beat is None else _kinds(beat["type"])
    parameter, text = ("PARAM_VALUE", "param_id", "param_value"), ("STATUSTEXT", "text")
    vehicle, odd = vehicle_facts(name, messages, parameter, text, kinds)
    armed, modes = None, ()
    if beat is not None:
        on, numbers = (whole_numbers(beat["base_mode"]) & _ARMED) != 0, whole_numbers(beat["custom_mode"])
        at = changes(on, numbers)
        names = (mode_name(vehicle, number) for number in numbers[at].tolist())
        armed, modes = state_of(zip(beat["t"][at].tolist(), on[at].tolist(), names, strict=True), messages.end)
    sounding, findings = _depth(messages, vehicle)
    found = (_outputs(messages), *_attitude(messages), _accelerometer(messages), sounding, *_filtered(messages),
             _battery(messages))  # fmt: skip
    return Streams(name, kind, by_name(found), vehicle, armed, modes, findings=(*messages.findings, *odd, *findings))


def _kinds(types: np.ndarray) -> tuple[Kind, ...]:
    """The kinds of vehicle that heartbeats name, the most frequent first."""
    numbers, counts = np.unique(types, return_counts=True)
    named = (kind_of_type(number, "HEARTBEAT.type") for number in numbers[np.argsort(-counts)][:_MOST_KINDS].tolist())
    return tuple(kind for kind in named if kind is not None)


def _outputs(messages: Messages) -> Stream | None:
    sent = messages.get("SERVO_OUTPUT_RAW", *_SERVOS[:8])
    if sent is None:
        return None
    names = [servo for servo in _SERVOS if servo in sent]
    main = sent["port"] == 0 if "port" in sent else slice(None)
    channels = (f"C{n + 1}" for n in range(len(names)))
    values = stacked(sent, names)[main]
    return stream("outputs", channels, "us", sent["t"][main], values, Sampling.SNAPSHOT, "SERVO_OUTPUT_RAW")


def _attitude(messages: Messages) -> tuple[Stream | None, Stream | None]:
    """Angles, and rates less the bias that the filter found."""
    table = messages.get("ATTITUDE", "roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")
    if table is None:
        return None, None
    axes = ("roll", "pitch", "yaw")
    angles = stream("attitude", axes, "rad", table["t"], stacked(table, axes), Sampling.ESTIMATED, "ATTITUDE")
    rates = stacked(table, (f"{axis}speed" for axis in axes))
    return angles, stream("gyro", "pqr", "rad/s", table["t"], rates, Sampling.MEASURED, "ATTITUDE")


def _accelerometer(messages: Messages) -> Stream | None:
    """Of the unit in use, or the next one that was recorded; ArduPilot sends all of them in thousandths of a weight."""
    for name in ("RAW_IMU", "SCALED_IMU", "SCALED_IMU2"):
        felt = messages.get(name, "xacc", "yacc", "zacc")
        if felt is not None:
            values = stacked(felt, ("xacc", "yacc", "zacc")) * _G
            return stream("accelerometer", ("ax", "ay", "az"), "m/s^2", felt["t"], values, Sampling.MEASURED, name)
    return None


def _depth(messages: Messages, vehicle: VehicleFacts) -> tuple[Stream | None, list[Finding]]:
    """Depth from the barometer that agrees with the altitude in use, as AP_Baro works it out."""
    use = messages.get("GLOBAL_POSITION_INT", "relative_alt")
    gravity = vehicle.parameters.get("BARO_SPEC_GRAV")
    found = {}
    for n, name in enumerate(_PRESSURES):
        table, ground = messages.get(name, "press_abs"), vehicle.parameters.get(f"BARO{n + 1}_GND_PRESS")
        if table is not None and ground and gravity:
            pressure = table["press_abs"].astype(np.float64) * 100.0  # hPa
            found[name] = table["t"], np.where(pressure > 0, (pressure - ground) / (_PA_A_METRE * gravity), np.nan)
    if not found:
        return None, []
    if use is None:
        sentence = "nothing tells which barometer is outside: depth is taken from the filter, if at all"
        return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Record GLOBAL_POSITION_INT", ("z",))]
    used = -use["relative_alt"].astype(np.float64) * 1e-3
    off = {}
    for name, (t, z) in found.items():
        difference = np.abs(z - np.interp(t, use["t"], used))
        off[name] = float(np.median(difference[np.isfinite(difference)])) if np.isfinite(difference).any() else np.inf
    best = min(off, key=lambda name: off[name])
    if not off[best] < _SAME_M:
        sentence = (
            f"no barometer follows the depth in use (nearest by {off[best]:.2f} m): depth is taken from the filter"
        )
        return None, [Finding(Severity.WARNING, "which_barometer", sentence, "Look at SCALED_PRESSURE", ("z",))]
    t, z = found[best]
    return stream("depth", "z", "m", t, z, Sampling.MEASURED, best), []


def _filtered(messages: Messages) -> tuple[Stream | None, Stream | None]:
    table = messages.get("LOCAL_POSITION_NED", "x", "y", "z", "vx", "vy", "vz")
    if table is None:
        return None, None
    place, speed = stacked(table, ("x", "y", "z")), stacked(table, ("vx", "vy", "vz"))
    leave_out_unknown(place, speed, table["t"], messages.get("EKF_STATUS_REPORT", "flags"), "flags")
    what = "LOCAL_POSITION_NED"
    position = stream("position", "xyz", "m", table["t"], place, Sampling.ESTIMATED, what)
    return position, stream("velocity", ("north", "east", "down"), "m/s", table["t"], speed, Sampling.ESTIMATED, what)


def _battery(messages: Messages) -> Stream | None:
    power = messages.get("SYS_STATUS", "voltage_battery", "current_battery")
    if power is None:
        return None
    raw = stacked(power, ("voltage_battery", "current_battery"))
    values = np.where((raw == [65535, -1]) | (raw == [0, -1]), np.nan, raw * [1e-3, 1e-2])  # 65535, -1: not known
    return stream("battery", ("voltage", "current"), ("V", "A"), power["t"], values, Sampling.MEASURED, "SYS_STATUS")


class Received:
    """Messages of vehicles in the order in which they were received; ``loss`` takes what has no room."""

    def __init__(self, loss: Loss) -> None:
        self._rows: dict[int, dict[str, Rows]] = {}  # by number of the vehicle and name of the message
        self._texts: dict[int, dict[str, list[str]]] = {}  # the one field of each row that is a text
        self._heard: set[tuple[int, int, int]] = set()
        self._budget = Budget(loss)
        self._loss = loss
        self._count = 0

    def __bool__(self) -> bool:
        return bool(self._rows)

    def add(self, system: int, name: str, received: float, fields: Mapping[str, Any]) -> None:
        """Take a message of a vehicle; one that lacks a field is not taken.

        Raises:
            TypeError: if a field is of another type than the message has.
            ValueError: for a count, a time or a text that cannot be one.
            OverflowError: for a number of hundreds of digits.
        """
        wanted = WANTED[name]
        if not all(field in fields for field in wanted):
            return
        row = [float(self._count), received]
        text = None
        for field in wanted:
            if field in TEXTS:
                text = str(fields[field])[:MOST_CHARACTERS]
            else:
                row.append(_count(fields[field]) if field in COUNTS else float(fields[field]))
        if name == "HEARTBEAT":
            self._heard.add((system, int(fields["type"]), int(fields["autopilot"])))
        if not self._budget.take(len(row)):
            return
        rows, texts = self._rows.setdefault(system, {}), self._texts.setdefault(system, {})
        if text is not None:
            if len(texts.setdefault(name, [])) >= MOST_TEXTS:
                self._loss.beyond(f"further messages {name}")
                return
            texts[name].append(text)
        rows.setdefault(name, Rows(len(row))).add(row)
        self._count += 1

    def streams(self, file: str, kind: str, system: int | None, findings: Iterable[Finding]) -> Streams:
        """The streams of the vehicle ``system``, or of the only one; ``findings`` are what there is to say of the file.

        Raises:
            FlightLogError: if there is no such vehicle, or several.
        """
        types: dict[str, dict[str, np.ndarray]] = {}
        system = _choose_vehicle(file, self._heard, system)
        for name, rows in self._rows.get(system, {}).items():
            numbers = iter(rows.array().T)
            types[name] = {AT: next(numbers), "received": next(numbers)}
            for field in WANTED[name]:
                types[name][field] = np.array(self._texts[system][name]) if field in TEXTS else next(numbers)
        _set_times(types)
        return _streams_of(file, kind, in_order(types, findings))


def _count(value: Any) -> float:
    """A field that counts something: a whole number of up to 64 bits.

    Raises:
        TypeError: if it is no number.
        ValueError: if it is another one.
    """
    if not (0 <= value < 2**64 and value == int(value)):
        raise ValueError(value)
    return float(value)


def _set_times(types: dict[str, dict[str, np.ndarray]]) -> None:
    """``t`` of each message: its time since boot, put where it was received, without the delays of the link."""
    booted = [c for c in types.values() if "time_boot_ms" in c]
    if not booted:
        for columns in types.values():
            columns["t"] = columns["received"]
        return
    at = np.concatenate([c[AT] for c in booted])
    order = np.argsort(at)
    boot = np.concatenate([c["time_boot_ms"] for c in booted])[order] * 1e-3
    late = np.concatenate([c["received"] for c in booted])[order] - boot
    starts = np.concatenate(([0], np.flatnonzero(np.diff(boot) < -_RESTART_S) + 1))
    offsets = np.array([np.percentile(part, 5) for part in np.split(late, starts[1:])])
    begins = at[order][starts]
    for columns in types.values():
        offset = offsets[np.maximum(np.searchsorted(begins, columns[AT], side="right") - 1, 0)]
        if "time_boot_ms" in columns:
            columns["t"] = columns["time_boot_ms"] * 1e-3 + offset
        elif "time_usec" in columns:
            since = columns["time_usec"] * 1e-6
            turns = np.round((columns["received"] - offset - since) / _WRAP_S)
            columns["t"] = since + turns * _WRAP_S + offset
        else:
            columns["t"] = columns["received"]
