"""Tables and recordings whose columns or messages are the owner's own, read as a mapping says."""

import struct
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.readers.bounds import Budget, Loss, Rows
from auv_torchrl.flightlog.readers.recording import Channel
from auv_torchrl.flightlog.readers.ros import ros
from auv_torchrl.flightlog.readers.ros.ros_types import CDR, ROS1, DefinitionError, Type, Values
from auv_torchrl.flightlog.streams.stream import (
    Floats,
    MappedStream,
    Place,
    Streams,
    VehicleFacts,
    by_name,
    stream,
)
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.settings import choices
from auv_torchrl.text import whole

_CLOCK = ("t", "time", "timestamp")  # how the column of the time may be called, in s


def streams_of_table(table: Table, mapping: Iterable[MappedStream]) -> Streams:
    """The streams of a table in which a row has what arrived at its time, and nothing else.

    Raises:
        FlightLogError: for a column that is not there, or a mapping with topics.
    """
    mapping = tuple(mapping)
    if topics := [one.topic for one in mapping if one.topic]:
        raise FlightLogError(f"{table.name} is a table and has no topics such as {topics[0]}: leave topic out")
    clock = next((name for name in _CLOCK if name in table.columns), None)
    if clock is None:
        raise FlightLogError(f"{table.name} has no column {' or '.join(_CLOCK)}: give the time in s")
    t = table.columns[clock]
    found = []
    for one in mapping:
        numbers = np.stack([_column(table, place) for place in one.places], axis=-1)
        source = f"{table.name}, {', '.join(place.name for place in one.places)}"
        found.append(stream(one.name, one.channels, one.unit, t, one.converted(numbers), one.sampling, source))
    mapped = {place.name for one in mapping for place in one.places}
    others = tuple(f for f in table.findings if not f.columns or set(f.columns) & mapped)
    return _checked(Streams(table.name, "table, as mapped", by_name(found), findings=others), mapping)


def _column(table: Table, place: Place) -> Floats:
    if place.name not in table.columns:
        raise FlightLogError(f"{table.name} has no column {place.name}: {choices([place.name], sorted(table.columns))}")
    return table.columns[place.name]


@np.errstate(invalid="ignore", over="ignore")  # of numbers in a damaged file
def streams_of_recording(path: Path, mapping: Iterable[MappedStream]) -> Streams:
    """The streams of a recording of ROS messages, whatever contains them; their types may be of any package.

    Raises:
        FlightLogError: for a topic that is not there, or whose type the recording does not describe.
    """
    mapping, loss = tuple(mapping), Loss()
    if bare := [one.name for one in mapping if not one.topic]:
        raise FlightLogError(f"{path.name} is a recording, and {bare[0]} has no topic in the mapping: say on which")
    seen: dict[Channel, None] = {}
    places: dict[str, list[Place]] = {}  # by topic, those of its streams one after the other
    for one in mapping:
        places.setdefault(one.topic.strip("/"), []).extend(one.places)
    types: dict[Channel, Type | None] = {}
    rows: dict[str, Rows] = {}
    budget, refused = Budget(loss), dict[str, str]()

    def wanted(channel: Channel) -> bool:
        return channel.topic.strip("/") in places and channel.encoding in (CDR, ROS1)

    for channel, time_ns, data in ros.messages(path, wanted, seen, loss):
        topic = channel.topic.strip("/")
        if channel not in types:
            try:
                types[channel] = Type(channel.kind, channel.definition, channel.encoding)
            except DefinitionError as error:
                types[channel], refused[topic] = None, f"its type {channel.kind} cannot be read ({error})"
        if (kind := types[channel]) is None:
            continue
        try:
            values = kind.values(ros.plain(data))
            row = [time_ns * 1e-9, *(_found(path, channel, values, place) for place in places[topic])]
        except FlightLogError:
            raise
        except (struct.error, ValueError, TypeError, OverflowError):
            loss.add("messages that cannot be read")
            continue
        if budget.take(len(row)):
            rows.setdefault(topic, Rows(len(row))).add(row)
        if loss.stopped:
            break
    there = sorted(channel.topic for channel in seen)
    for topic in sorted(set(places) - set(rows)):
        if topic not in {name.strip("/") for name in there}:
            raise FlightLogError(f"{path.name} has no topic {topic}: {choices([topic], there)}")
        why = refused.get(topic, "no message on it can be read")
        raise FlightLogError(f"{path.name}: of {topic} nothing is read: {why}")
    return _checked(_streams(path.name, mapping, {t: kept.array() for t, kept in rows.items()}, loss), mapping)


def _streams(name: str, mapping: tuple[MappedStream, ...], rows: dict[str, Floats], loss: Loss) -> Streams:
    start = min(float(values[:, 0].min()) for values in rows.values())
    at, found = dict.fromkeys(rows, 1), []
    for one in mapping:
        topic = one.topic.strip("/")
        values, first = rows[topic], at[topic]
        at[topic] += len(one.places)
        numbers = values[:, first : at[topic]]
        times = values[:, 0] - start
        found.append(stream(one.name, one.channels, one.unit, times, one.converted(numbers), one.sampling, one.topic))
    return Streams(name, "recording, as mapped", by_name(found), VehicleFacts(), findings=tuple(loss.findings()))


def _found(path: Path, channel: Channel, values: Values, place: Place) -> float:
    try:
        return _number(values, place)
    except KeyError:
        has = choices([place.name], sorted(_names(values)))
        raise FlightLogError(
            f"{path.name}: messages on {channel.topic} ({channel.kind}) have no {place.name}: {has}"
        ) from None


def _number(values: Values, place: Place) -> float:
    """One number of a message; NaN where an array is too short for it.

    Raises:
        KeyError: for a field that it does not have.
        ValueError: for a field that is no number.
    """
    if place.name in values and not isinstance(values[place.name], tuple):
        return float(values[place.name])
    name, _, index = place.name.rpartition(".")
    array = values.get(name)
    if not isinstance(array, tuple) or (at := whole(index)) is None:
        raise KeyError(place.name)
    return float(array[at]) if 0 <= at < len(array) else np.nan


def _names(values: Values) -> list[str]:
    """Fields as a mapping names them, of an array its first number."""
    return [f"{name}.0" if isinstance(value, tuple) else name for name, value in values.items()]


def _checked(streams: Streams, mapping: tuple[MappedStream, ...]) -> Streams:
    """The streams, with a word where a mapped one has no number."""
    empty = [one for one in mapping if one.name not in streams.streams]
    if any(one.name == "commands" for one in empty):
        raise FlightLogError(f"{streams.name} has no number where the mapping says that the commands are")
    lost = tuple(
        Finding(Severity.WARNING, "mapped_nothing", f"{one.name} has no number where the mapping says") for one in empty
    )
    return replace(streams, findings=(*streams.findings, *lost))
