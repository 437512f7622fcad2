"""What the messages of an ArduPilot log mean: the streams, the vehicle, arming and modes.

https://ardupilot.org/sub/docs/logmessages.html lists the messages. Raw sensors come before the filter (EKF); of the
filter it is the lane in use. Position and horizontal velocity are taken where the filter says that it has them.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from auv_torchrl.flightlog.findings import Finding
from auv_torchrl.flightlog.readers.ardupilot.ardupilot_sensors import depth, inertial
from auv_torchrl.flightlog.readers.ardupilot.firmware import (
    latest,
    leave_out_unknown,
    mode_name,
    of_lane,
    primary_lane,
    rows,
    spelt,
    vehicle_facts,
)
from auv_torchrl.flightlog.readers.messages import Columns, Messages, stacked, whole_numbers
from auv_torchrl.flightlog.streams.attitude import euler_angles
from auv_torchrl.flightlog.streams.compass import COMPASSES, MOST_SAMPLES
from auv_torchrl.flightlog.streams.configuration import changed_in_flight
from auv_torchrl.flightlog.streams.stream import (
    Kind,
    Sampling,
    Spans,
    Stream,
    Streams,
    VehicleFacts,
    by_name,
    spans_of,
    stream,
)
from auv_torchrl.flightlog.streams.vehicle_kind import kind_of_build

WANTED = {
    "PARM": ("TimeUS", "Name", "Value"),
    "MSG": ("TimeUS", "Message"),
    "VER": ("TimeUS", "BU"),
    "MODE": ("TimeUS", "ModeNum", "Mode"),
    "ARM": ("TimeUS", "ArmState"),
    "EV": ("TimeUS", "Id"),
    "RCOU": ("TimeUS", *(f"C{i}" for i in range(1, 15))),
    "RCO2": ("TimeUS", *(f"C{i}" for i in range(15, 19))),
    "IMU": ("TimeUS", "I", "GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"),
    "ATT": ("TimeUS", "Roll", "Pitch", "Yaw"),
    "XKQ": ("TimeUS", "C", "Q1", "Q2", "Q3", "Q4"),
    "XKF1": ("TimeUS", "C", "PN", "PE", "PD", "VN", "VE", "VD", "GX", "GY", "GZ"),
    "XKF2": ("TimeUS", "C", "AX", "AY", "AZ"),
    "XKF3": ("TimeUS", "C", "IVN", "IVE"),
    "XKF4": ("TimeUS", "C", "SS", "PI"),
    "XKFS": ("TimeUS", "C", "GI"),
    "BARO": ("TimeUS", "I", "Alt"),
    "CTUN": ("TimeUS", "BAlt"),
    "VISO": ("TimeUS", "dt", "PosDX", "PosDY", "PosDZ"),
    "MAG": ("TimeUS", "I", "MagX", "MagY", "MagZ"),
    "BAT": ("TimeUS", "I", "Inst", "Instance", "Volt", "Curr"),
}
_ARMED, _DISARMED = 10, 11  # EV.Id


def streams_of(name: str, kind: str, messages: Messages) -> Streams:
    """The streams of a log whose messages have the fields of :data:`WANTED`, times in s."""
    primary, lane, findings = primary_lane(messages)
    built = _built_for(messages)
    vehicle, odd = vehicle_facts(name, messages, ("PARM", "Name", "Value"), ("MSG", "Message"), built)
    sounding, more = depth(messages, primary)
    modes = _modes(messages, vehicle)
    found = (
        _outputs(messages), _attitude(messages, primary, lane),
        *inertial(messages, primary, lane, vehicle.parameters), sounding,
        *_filtered(messages, primary, lane), _doppler(messages), _battery(messages), *_compasses(messages),
    )  # fmt: skip
    return Streams(
        name=name,
        format=kind,
        streams=by_name(found),
        vehicle=vehicle,
        armed=_armed(messages),
        modes=modes,
        findings=(*messages.findings, *odd, *findings, *more, *_set_in_flight(messages)),
    )


def _built_for(messages: Messages) -> list[Kind]:
    version = messages.get("VER", "BU")
    if version is None:
        return []
    kinds = (
        kind_of_build(number, "build of the firmware, VER")
        for number in np.unique(whole_numbers(version["BU"])).tolist()
    )
    return [kind for kind in kinds if kind is not None]


def _set_in_flight(messages: Messages) -> Iterator[Finding]:
    given = messages.get("PARM", "Name", "Value")
    if given is not None:
        yield from changed_in_flight(given["t"], [spelt(name) for name in given["Name"]], given["Value"])


def _modes(messages: Messages, vehicle: VehicleFacts) -> tuple[tuple[float, str], ...]:
    mode = messages.get("MODE")
    if mode is None:
        return ()
    given = mode["ModeNum"] if "ModeNum" in mode else mode.get("Mode")
    if given is None:
        return ()
    numbers = whole_numbers(given).tolist()
    return tuple((t, mode_name(vehicle, n)) for t, n in zip(mode["t"].tolist(), numbers, strict=True))


def _armed(messages: Messages) -> Spans | None:
    """When the vehicle was armed. If the first that is told is the disarming, it was armed before."""
    arm, event = messages.get("ARM", "ArmState"), messages.get("EV", "Id")
    changes = [] if arm is None else [(t, n > 0) for t, n in _numbered(arm, "ArmState")]
    if not changes and event is not None:
        changes = [(t, n == _ARMED) for t, n in _numbered(event, "Id") if n in (_ARMED, _DISARMED)]
    spans: list[tuple[float, float]] = []
    for begin, stop in pairwise((-np.inf, *messages.starts, np.inf)):  # each start of the vehicle by itself
        within = [(t - max(begin, 0.0), on) for t, on in sorted(changes) if begin <= t < stop]
        found = spans_of(within, min(stop, messages.end) - max(begin, 0.0)) or ()
        spans += [(a + max(begin, 0.0), b + max(begin, 0.0)) for a, b in found]
    return tuple(spans) if changes else None


def _numbered(columns: Columns, field: str) -> Iterator[tuple[float, int]]:
    return zip(columns["t"].tolist(), whole_numbers(columns[field]).tolist(), strict=True)


def _outputs(messages: Messages) -> Stream | None:
    sent = messages.get("RCOU")
    if sent is None:
        return None
    names = [name for name in WANTED["RCOU"][1:] if name in sent]
    values = [sent[name].astype(np.float64) for name in names]
    more = messages.get("RCO2")
    if more is not None:
        near = latest(more["t"], sent["t"] + 5e-3)  # written right after RCOU
        late = np.abs(more["t"][near] - sent["t"]) > 0.05
        names += (extra := [name for name in WANTED["RCO2"][1:] if name in more])
        values += [np.where(late, np.nan, more[name][near]) for name in extra]
    return (
        stream("outputs", names, "us", sent["t"], np.stack(values, -1), Sampling.SNAPSHOT, "RCOU") if values else None
    )


def _attitude(messages: Messages, primary: Columns | None, lane: int) -> Stream | None:
    channels = ("roll", "pitch", "yaw")
    quaternion = messages.get("XKQ", "Q1", "Q2", "Q3", "Q4")
    if quaternion is not None:
        kept = of_lane(quaternion, primary, lane)
        angles = euler_angles(stacked(kept, ("Q1", "Q2", "Q3", "Q4")))
        found = stream("attitude", channels, "rad", kept["t"], angles, Sampling.ESTIMATED, f"XKQ, lane {lane}")
        if found is not None:
            return found
    angles = messages.get("ATT", "Roll", "Pitch", "Yaw")
    if angles is None:
        return None
    radians = np.deg2rad(stacked(angles, ("Roll", "Pitch", "Yaw")))
    return stream("attitude", channels, "rad", angles["t"], radians, Sampling.ESTIMATED, "ATT")


def _filtered(messages: Messages, primary: Columns | None, lane: int) -> tuple[Stream | None, Stream | None]:
    """Position and velocity in NED as the filter has them."""
    estimate = messages.get("XKF1", "PN", "PE", "PD", "VN", "VE", "VD")
    if estimate is None:
        return None, None
    estimate = of_lane(estimate, primary, lane)
    t = estimate["t"]
    place, speed = stacked(estimate, ("PN", "PE", "PD")), stacked(estimate, ("VN", "VE", "VD"))
    leave_out_unknown(place, speed, t, primary, "SS")
    what, drift = f"XKF1, lane {lane}", _innovation(messages, primary, lane)
    position = stream("position", "xyz", "m", t, place, Sampling.ESTIMATED, what, drift)
    return position, stream("velocity", ("north", "east", "down"), "m/s", t, speed, Sampling.ESTIMATED, what)


def _innovation(messages: Messages, primary: Columns | None, lane: int) -> float | None:
    """How far measured velocities were off those that the filter expected, m/s: about as far as it is off itself."""
    table = messages.get("XKF3", "IVN", "IVE")
    if table is None:
        return None
    table = of_lane(table, primary, lane)
    off = np.hypot(*stacked(table, ("IVN", "IVE")).T) / np.sqrt(2)
    return float(np.sqrt(np.mean(off[off > 0] ** 2))) if (off > 0).any() else None


def _doppler(messages: Messages) -> Stream | None:
    """Body velocity from the distances that a Doppler log gives, at the middle of the time in which it went them."""
    steps = messages.get("VISO", "dt", "PosDX", "PosDY", "PosDZ")
    if steps is None:
        return None
    during = steps["dt"].astype(np.float64)
    during = np.where((during > 1e-3) & (during < 5.0), during, np.nan)  # s
    speed = stacked(steps, ("PosDX", "PosDY", "PosDZ")) / during[:, None]
    return stream("dvl", "uvw", "m/s", steps["t"] - during / 2, speed, Sampling.MEASURED, "VISO")


def _battery(messages: Messages) -> Stream | None:
    power = messages.get("BAT", "Volt")
    if power is None:
        return None
    number = next((power[name] for name in ("Inst", "Instance", "I") if name in power), None)
    if number is not None:
        number = whole_numbers(number)
        power = rows(power, number == number.min())
    volts = power["Volt"].astype(np.float64)
    current = power["Curr"].astype(np.float64) if "Curr" in power else np.full(len(volts), np.nan)
    both = np.stack((volts, current), -1)
    return stream("battery", ("voltage", "current"), ("V", "A"), power["t"], both, Sampling.MEASURED, "BAT")


def _compasses(messages: Messages) -> Iterator[Stream | None]:
    """What each compass feels, less its offsets and what the autopilot takes out of it already."""
    table = messages.get("MAG", "MagX", "MagY", "MagZ")
    if table is None:
        return
    unit = table["I"] if "I" in table else np.zeros(len(table["t"]), np.uint8)
    for number, name in enumerate(COMPASSES):
        kept = np.flatnonzero(unit == number)
        kept = kept[:: 1 + len(kept) // MOST_SAMPLES]
        felt = np.stack([table[f"Mag{axis}"][kept].astype(np.float64) for axis in "XYZ"], -1)
        yield stream(name, ("mx", "my", "mz"), "mG", table["t"][kept], felt, Sampling.MEASURED, f"MAG {number}")
