"""What an owner has set wrong, from the parameters of the autopilot alone.

Some of it no vehicle should have; the rest is what differs from a flight in which the vehicle was sound. Names and
meanings: https://ardupilot.org/sub/docs/parameters.html.
"""

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from auv_torchrl.autopilot import function_of, is_function, motor_of
from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.streams.motors import outputs_of
from auv_torchrl.flightlog.streams.parameters import Use, Values, check_ranges, known, moves, parameter
from auv_torchrl.flightlog.streams.stream import Streams

DIRECTION, EXCHANGED = "motor_direction", "motors_exchanged"
SHOWN_BY_FLIGHT = (DIRECTION, EXCHANGED)  # codes: a flight shows whether wires or plugs were changed along with it
_WAYS = ("MIN", "MAX", "TRIM", "REVERSED")  # of the pulses of an output
_FULL = {"MOT_PWM_MIN": 1100.0, "MOT_PWM_MAX": 1900.0}  # us: what a T200 on its own speed controller takes
SET_IN_FLIGHT = "set_in_flight"  # code of findings about parameters that were set while the log was written
_LISTED = 6  # parameters that are named
_ON_ITS_BACK = -0.5  # mean of cos(roll) cos(pitch), below which a vehicle seems to fly upside down


def check_configuration(streams: Streams, parameters: Values) -> list[Finding]:
    """What no vehicle of this frame should have, worst first."""
    parameters = known(parameters)
    if "commands" in streams.streams or not parameters:
        return []
    motors = streams.vehicle.motors or max(outputs_of(parameters), default=0)
    plugged, pulses = _plugged(parameters, motors), _pulses(parameters)
    return [*check_ranges(parameters), *plugged, *pulses, *_upside_down(streams, parameters)]


def compare_configuration(parameters: Values, healthy: Sequence[Values]) -> list[Finding]:
    """What differs from the flights in which the vehicle was sound, as far as they agree with each other.

    What is no finite number in one of them is not compared.
    """
    parameters, flights = known(parameters), [values for values in map(known, healthy) if values]
    if not parameters or not flights:
        return []
    sound = {n: v for n, v in flights[0].items() if all(other.get(n) == v for other in flights[1:])}
    differ = {name: value for name, value in parameters.items() if name in sound and sound[name] != value}
    found = list(_exchanged(differ, sound))
    named = {name for finding in found for name, _ in finding.param}
    rest = {name: value for name, value in differ.items() if name not in named}
    found += [_turned(n, value, sound[n]) for n, value in rest.items() if moves(n)]
    others = sorted(n for n in rest if _is_other(n))
    if others:
        listed = ", ".join(f"{n} {parameters[n]:g} (was {sound[n]:g})" for n in others[:_LISTED])
        more = f" and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
        sentence = f"other parameters differ from the healthy flight, too: {listed}{more}"
        found.append(Finding(Severity.INFO, "other_parameters", sentence))
    return found


def changed_in_flight(t: np.ndarray, names: Sequence[str], values: np.ndarray) -> Iterator[Finding]:
    """A finding for each parameter that was set while the log was written, and that says how it is to be read."""
    first: dict[str, float] = {}
    for at, name, value in zip(t, names, values, strict=True):
        if not np.isfinite(value) or not moves(name):
            continue
        if value != first.setdefault(name, value):
            sentence = f"{name} was set from {first[name]:g} to {value:g} at {at:.1f} s; all of the log is read with it"
            remedy = "Give a log that was begun after the parameter was set"
            yield Finding(Severity.WARNING, SET_IN_FLIGHT, sentence, remedy, limits=True)
            first[name] = value


def to_set(findings: Iterable[Finding]) -> dict[str, float]:
    """The parameters that these findings say should be set."""
    return known(*(dict(finding.param) for finding in findings))


def _is_other(name: str) -> bool:
    """Whether a parameter neither changes how a log is read nor is written by the vehicle itself."""
    entry = parameter(name)
    return entry is None or entry.use is Use.VALUE


def _plugged(parameters: Values, motors: int) -> Iterator[Finding]:
    """Motors that are on no output or on two, and functions that do not go in order."""
    plugged = outputs_of(parameters)
    for n in (n for n in range(1, motors + 1) if n not in plugged):
        name, wanted = f"SERVO{n}_FUNCTION", function_of(n)
        if name not in parameters:
            continue  # it is asked for by name
        there = motor_of(parameters[name])
        free = not there or len(plugged[there]) > 1  # else that motor would lose its output
        sentence = f"motor {n} is on no output (no SERVOn_FUNCTION is {wanted}): it gives nothing, whatever is wanted"
        remedy = f"Set {name} to {wanted} (it is {parameters[name]:g}), or that of the output that it is plugged into"
        yield Finding(
            Severity.WARNING, "motor_on_no_output", sentence, remedy, param=((name, float(wanted)),) if free else ()
        )
    for n, on in plugged.items():
        if len(on) > 1:
            sentence = f"motor {n} is on outputs {' and '.join(map(str, on))}"
            yield Finding(
                Severity.WARNING, "motor_on_two_outputs", sentence, "Give each output the motor that is plugged into it"
            )
    moved = {n: on[0] for n, on in sorted(plugged.items()) if on != [n] and len(on) == 1 and on[0] <= motors}
    if moved and set(moved) == set(moved.values()):
        which, where = (", ".join(map(str, numbers)) for numbers in (moved, moved.values()))
        sentence = f"motors {which} are on outputs {where}, not in the order of the frame"
        wanted = ", ".join(f"SERVO{n}_FUNCTION to {function_of(n)}" for n in moved)
        remedy = f"That is right if they are plugged in so; else set {wanted}"
        yield Finding(Severity.INFO, "motors_not_in_order", sentence, remedy)


def _pulses(parameters: Values) -> Iterator[Finding]:
    """Limits and trims that one motor has and the others have not, and limits that take thrust from all."""
    outputs = sorted(k for on in outputs_of(parameters).values() for k in on)
    for way in _WAYS:
        values = {k: parameters[f"SERVO{k}_{way}"] for k in outputs if f"SERVO{k}_{way}" in parameters}
        counted = Counter(values.values()).most_common(2)
        if len(counted) < 2 or counted[0][1] <= len(values) / 2:
            continue  # all alike, or no value that most of them have
        usual = counted[0][0]
        for k, value in values.items():
            if value != usual:
                name = f"SERVO{k}_{way}"
                motor = motor_of(parameters[f"SERVO{k}_FUNCTION"])
                sentence = f"{name}, of motor {motor}, is {value:g}, and {usual:g} for the other motors"
                yield Finding(
                    Severity.WARNING, "uneven_pulses", sentence, f"Set {name} to {usual:g}", param=((name, usual),)
                )
    short = {n: parameters[n] for n, full in _FULL.items() if n in parameters and abs(parameters[n] - full) > 50}
    if short and all(short.values()):  # 0 takes the range of the throttle
        widths = " and ".join(f"{name} {value:g}" for name, value in short.items())
        sentence = (
            f"pulses are limited by {widths} us where thrusters commonly take 1100 to 1900: full command is {widths}"
        )
        remedy = "That is right if the vehicle file's full thrust is meant at these pulses"
        yield Finding(Severity.INFO, "pulse_limits", sentence, remedy)


def _upside_down(streams: Streams, parameters: Values) -> Iterator[Finding]:
    attitude = streams.streams.get("attitude")
    orientation = parameters.get("AHRS_ORIENTATION")
    if attitude is None or orientation is None or not {"roll", "pitch"} <= set(attitude.channels):
        return
    roll, pitch = (attitude.values[:, attitude.channels.index(axis)] for axis in ("roll", "pitch"))
    if np.nanmean(np.cos(roll) * np.cos(pitch)) < _ON_ITS_BACK:
        sentence = f"the vehicle lies on its back all along, says its attitude: AHRS_ORIENTATION is {orientation:g}"
        remedy = "Set AHRS_ORIENTATION to how the autopilot is mounted, and calibrate the accelerometer"
        yield Finding(Severity.WARNING, "upside_down", sentence, remedy, ("roll", "pitch"), limits=True)


def _exchanged(differ: Values, sound: Values) -> Iterator[Finding]:
    """Outputs whose motors were dealt out anew."""
    functions = {n: v for n, v in differ.items() if is_function(n)}
    now, before = (sorted(map(motor_of, values)) for values in (functions.values(), (sound[n] for n in functions)))
    if len(functions) < 2 or now != before or not all(now):
        return
    motors = " and ".join(map(str, now))
    back = ", ".join(f"{name} to {sound[name]:g}" for name in functions)
    sentence = f"motors {motors} have exchanged their outputs since the healthy flight"
    param = tuple((name, sound[name]) for name in functions)
    yield Finding(Severity.WARNING, EXCHANGED, sentence, f"Set {back}, or exchange the plugs, too", param=param)


def _turned(name: str, value: float, sound: float) -> Finding:
    """One parameter that differs from the healthy flight."""
    motor = re.fullmatch(r"MOT_([0-9]+)_DIRECTION", name)
    code = DIRECTION if motor else "parameter_differs"
    which = f", the direction of motor {motor[1]}," if motor else ""
    sentence = f"{name}{which} is {value:g}, and was {sound:g} in the healthy flight"
    return Finding(Severity.WARNING, code, sentence, f"Set {name} to {sound:g}", param=((name, sound),))
