"""What the columns of a table, or the fields of messages, stand for, where only their owner knows: ``mapping=FILE``.

A YAML file with one entry for each stream. For example::

    commands:
      topic: /rovio/thrusters            # of a recording; a table has none
      values: [data.0, data.1, -data.2]  # numbers of an array, in the order of the thrusters; - for the other sign
      unit: us
      sampling: held
    attitude:
      topic: /sensor_fusion/states
      values: {roll: data.0, pitch: data.1, yaw: data.2}
      unit: rad
"""

from collections.abc import Mapping
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np

from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.streams.motors import NEUTRAL
from auv_torchrl.flightlog.streams.stream import MappedStream, Place, Sampling
from auv_torchrl.settings import choices
from auv_torchrl.yaml_file import read_yaml

_CHANNELS = {  # of each stream that an owner may map: its channels, their unit, and how they are sampled if unsaid
    "commands": ((), "1", Sampling.HELD),
    "position": (("x", "y", "z"), "m", Sampling.ESTIMATED),
    "depth": (("z",), "m", Sampling.MEASURED),
    "attitude": (("roll", "pitch", "yaw"), "rad", Sampling.ESTIMATED),
    "dvl": (("u", "v", "w"), "m/s", Sampling.MEASURED),
    "body_velocity": (("u", "v", "w"), "m/s", Sampling.ESTIMATED),
    "gyro": (("p", "q", "r"), "rad/s", Sampling.MEASURED),
    "accelerometer": (("ax", "ay", "az"), "m/s^2", Sampling.MEASURED),
    "battery": (("voltage",), "V", Sampling.MEASURED),
}
_FACTORS = {  # by unit of a stream: what one unit of the owner's is in it
    "1": {"1": 1.0, "us": 1 / 400, "%": 0.01},  # full command is 1100 and 1900 us, as thrusters commonly take them
    "m": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "rad": {"rad": 1.0, "deg": np.pi / 180},
    "m/s": {"m/s": 1.0, "cm/s": 0.01, "mm/s": 0.001},
    "rad/s": {"rad/s": 1.0, "deg/s": np.pi / 180},
    "m/s^2": {"m/s^2": 1.0, "g": 9.80665},
    "V": {"V": 1.0, "mV": 0.001},
}
_ENTRIES = ("topic", "values", "unit", "sampling", "scale", "offset")


def read_mapping(path: str | Path) -> tuple[MappedStream, ...]:
    """The streams that a mapping describes.

    Raises:
        FlightLogError: for a file that cannot be read, or an entry that is missing, unknown or makes no sense.
    """
    try:
        content = read_yaml(Path(path), "mapping")
        if not content:
            raise ValueError(f"it describes nothing: give {', '.join(_CHANNELS)}")
        if odd := sorted(map(str, set(content) - set(_CHANNELS))):
            raise ValueError(f"unknown streams {odd}: {choices(odd, sorted(_CHANNELS))}")
        found = tuple(_stream(name, entry) for name, entry in content.items())
        if "commands" not in content:
            raise ValueError("commands is missing: say where the commands of the thrusters are")
        if len({bool(one.topic) for one in found}) > 1:
            raise ValueError("some streams have a topic and others none: give a topic to all, or to none for a table")
    except (ValueError, FileNotFoundError) as error:
        raise FlightLogError(f"mapping={path}: {error}") from error
    return found


def _stream(name: str, entry: Any) -> MappedStream:
    if not isinstance(entry, Mapping):
        raise ValueError(f"{name} is {short(entry)}: give a mapping with {', '.join(_ENTRIES)}")
    if odd := sorted(map(str, set(entry) - set(_ENTRIES))):
        raise ValueError(f"unknown entries {odd} in {name}: {choices(odd, list(_ENTRIES))}")
    known, unit, usual = _CHANNELS[name]
    channels, places = _values(name, entry.get("values"), known)
    given, factors = str(entry.get("unit", unit)), _FACTORS[unit]
    if given not in factors:
        raise ValueError(f"{name} has the unit {short(entry['unit'])}: {choices([given], sorted(factors))}")
    sampling = str(entry.get("sampling", usual))
    if sampling not in list(Sampling):
        raise ValueError(f"{name} has the sampling {short(sampling)}: {choices([sampling], sorted(Sampling))}")
    topic = entry.get("topic", "")
    if not isinstance(topic, str):
        raise ValueError(f"{name} has the topic {short(topic)}: give the name of a topic")
    scale, offset = (_number(name, entry, key, usual) for key, usual in (("scale", 1.0), ("offset", 0.0)))
    neutral = NEUTRAL if given == "us" else 0.0
    factor = factors[given]
    return MappedStream(
        name, channels, places, topic, unit, factor * scale, factor * (offset - neutral), Sampling(sampling)
    )


def _values(name: str, given: Any, known: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[Place, ...]]:
    """Channels and where each is found; commands are numbered as the thrusters are."""
    if name == "commands":
        if not isinstance(given, list) or not given:
            raise ValueError("commands has no list of values: give one for each thruster, in their order")
        return tuple(f"cmd_{n + 1}" for n in range(len(given))), tuple(_place(name, one) for one in given)
    if isinstance(given, list) and len(given) == len(known):
        given = dict(zip(known, given, strict=True))
    if not isinstance(given, Mapping) or not given or not set(given) <= set(known):
        raise ValueError(f"{name} has the values {short(given)}: say where {', '.join(known)} are, by name")
    return tuple(given), tuple(_place(name, one) for one in given.values())


def _place(name: str, given: Any) -> Place:
    place = given.strip() if isinstance(given, str) else ""
    if not place.strip("-"):
        raise ValueError(f"{name} has the value {short(given)}: give a column or a field, such as data.0 or -depth")
    return Place(place.removeprefix("-").strip(), -1.0 if place.startswith("-") else 1.0)


def _number(name: str, entry: Mapping[str, Any], key: str, usual: float) -> float:
    value = entry.get(key, usual)
    if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
        raise ValueError(f"{name} has the {key} {short(value)}: give a number")
    return float(value)
