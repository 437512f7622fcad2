"""From the pulses of the outputs to the commands of the thrusters, by the parameters of the vehicle.

ArduSub sends a motor ``1500 + command * MOT_n_DIRECTION * 400`` µs (with the usual limits) through the output whose
SERVOk_FUNCTION is that of motor n. What it wanted of the motor, along the direction that the frame gives it, is the
command: a wrong MOT_n_DIRECTION then shows as a thruster that pushes backwards, which is what it makes of the vehicle.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from auv_torchrl.autopilot import motor_of
from auv_torchrl.flightlog.findings import FlightLogError, quoted
from auv_torchrl.flightlog.streams.stream import DAMAGED, WHICH_COMMANDS, Stream, Streams, stream

NEUTRAL = 1500.0  # us, at which a motor stands; fixed in ArduSub
_OUTPUTS = 32


class Motors(NamedTuple):
    """Where each motor is plugged in and what its pulses mean; motor n is entry n - 1."""

    output: tuple[int, ...]  # from 1; 0 for a motor that is on none
    direction: tuple[float, ...]  # 1 or -1
    low: float  # us, full command backwards
    high: float  # us, full command


def motors_of(parameters: Mapping[str, float], frame_motors: int | None) -> tuple[Motors | None, tuple[str, ...]]:
    """The motors, or None and the names of the parameters that are not known."""
    output = {motor: min(on, key=lambda k: (k != motor, k)) for motor, on in outputs_of(parameters).items()}
    number = frame_motors or max(output, default=0)
    declared = {n for n in range(1, (number or 8) + 1) if f"SERVO{n}_FUNCTION" in parameters}
    unplugged = [n for n in range(1, number + 1) if n not in output]
    missing = [
        f"SERVO{n}_FUNCTION" for n in range(1, (number or 8) + 1) if n not in declared and (unplugged or not output)
    ]
    if not number:
        missing.insert(0, "FRAME_CONFIG")
    directions = [f"MOT_{n}_DIRECTION" for n in range(1, (number or 8) + 1)]
    missing += [name for name in directions if name not in parameters]
    low, high = (_limit(parameters, end) for end in ("MIN", "MAX"))
    missing += [f"MOT_PWM_{end}" for end, value in (("MIN", low), ("MAX", high)) if value is None]
    if missing or low is None or high is None:
        return None, tuple(missing)
    if not output:
        raise FlightLogError("no motor is on any output: set SERVO1_FUNCTION to 33 and so on, as they are plugged in")
    if not low < NEUTRAL < high:
        raise FlightLogError(f"MOT_PWM_MIN {low:g} and MOT_PWM_MAX {high:g} do not enclose {NEUTRAL:g}: correct them")
    signs = tuple(parameters[name] for name in directions)
    if any(abs(sign) != 1 for sign in signs):
        raise FlightLogError(f"MOT_n_DIRECTION are {', '.join(f'{s:g}' for s in signs)}: each is 1 or -1")
    return Motors(tuple(output.get(n, 0) for n in range(1, number + 1)), signs, low, high), ()


def outputs_of(parameters: Mapping[str, float]) -> dict[int, list[int]]:
    """By motor, the outputs that have its function."""
    found: dict[int, list[int]] = {}
    for k in range(1, _OUTPUTS + 1):
        if motor := motor_of(parameters.get(f"SERVO{k}_FUNCTION", 0.0)):
            found.setdefault(motor, []).append(k)
    return found


def commands_of(streams: Streams, parameters: Mapping[str, float]) -> Stream:
    """The commands of the thrusters in [-1, 1], as the file has them or by the ``parameters`` of the vehicle.

    Raises:
        FlightLogError: if the file has none, naming what is missing and how to give it.
    """
    if "commands" in streams.streams:
        return streams.streams["commands"]
    outputs = streams.streams.get("outputs")
    if outputs is None:
        if damage := [finding for finding in streams.findings if finding.code == DAMAGED]:
            raise FlightLogError(f"{streams.name} has no outputs of thrusters that can be read: {quoted(damage)}")
        for finding in streams.findings:
            if finding.code == WHICH_COMMANDS:
                raise FlightLogError(
                    f"{streams.name} does not say what the thrusters were told: {finding.sentence}: {finding.remedy}"
                )
        there = ", ".join(streams.streams) or "nothing"
        raise FlightLogError(
            f"{streams.name} does not say what the thrusters were told (it has {there}): log the outputs (RCOU, "
            "SERVO_OUTPUT_RAW, actuator_motors, RCOut)"
        )
    motors, missing = motors_of(parameters, streams.vehicle.motors)
    if motors is None:
        raise FlightLogError(f"{streams.name} has pulses of its outputs, and lacks {listed(missing)}: {HOW_TO_GIVE}")
    off = np.full(len(outputs), NEUTRAL)  # a motor on no output is told nothing
    pulse = np.stack([_channel(outputs, k, streams.name) if k else off for k in motors.output], axis=-1)
    values = np.array(motors.direction) * commands_of_pulses(pulse, motors.low, motors.high)
    channels = (f"cmd_{n + 1}" for n in range(len(motors.output)))
    sent = stream("commands", channels, "1", outputs.t, values, outputs.sampling, outputs.source)
    if sent is None:
        raise FlightLogError(f"{streams.name}: the outputs of the motors are off all along: give a log of a dive")
    return sent


def commands_of_pulses(pulse: np.ndarray, low: float, high: float) -> np.ndarray:
    """Commands in [-1, 1] of pulses in us whose ends are full command; NaN for an output that is off, which has 0."""
    away = np.where(pulse > 0, pulse, np.nan) - NEUTRAL
    return away / np.where(away > 0, high - NEUTRAL, NEUTRAL - low)


HOW_TO_GIVE = (
    "save all parameters of the vehicle (in QGroundControl: Vehicle Setup, Parameters, Tools, Save to file) and give "
    "params=FILE, or the values: params={MOT_1_DIRECTION: 1, ...}"
)


def listed(names: tuple[str, ...]) -> str:
    """Names of parameters, runs of numbers shortened."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(re.sub(r"[0-9]", "", name), []).append(name)
    return ", ".join(group[0] if len(group) == 1 else f"{group[0]} to {group[-1]}" for group in kinds.values())


def _limit(parameters: Mapping[str, float], end: str) -> float | None:
    value = parameters.get(f"MOT_PWM_{end}")
    return parameters.get(f"RC3_{end}") if value == 0 else value  # 0: the range of the throttle


def _channel(outputs: Stream, number: int, name: str) -> np.ndarray:
    wanted = f"C{number}"
    if wanted not in outputs.channels:
        has = f"{outputs.channels[0]} to {outputs.channels[-1]}"
        raise FlightLogError(f"{name} has outputs {has}, and a motor is on output {number}: log that one too")
    return outputs.values[:, outputs.channels.index(wanted)]
