"""What is in a log of a vehicle, and what could be diagnosed with it, in lines for people."""

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError
from auv_torchrl.flightlog.log import AXES, IDLE
from auv_torchrl.flightlog.readiness import begins
from auv_torchrl.flightlog.streams.compass import check_compass
from auv_torchrl.flightlog.streams.configuration import check_configuration, compare_configuration
from auv_torchrl.flightlog.streams.grid import choose, tabulate
from auv_torchrl.flightlog.streams.motors import listed, motors_of
from auv_torchrl.flightlog.streams.parameters import known
from auv_torchrl.flightlog.streams.stream import ReadOptions, Stream, Streams
from auv_torchrl.flightlog.streams.vehicle_kind import check_kind, other_kind
from auv_torchrl.flightlog.tables.columns import extra_of, missing
from auv_torchrl.flightlog.tables.rows import runs_of_time
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.flightlog.understand import understand
from auv_torchrl.quantities import counted
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

_LISTED = 8  # stretches that are listed one by one
_WIDEST = 24  # letters of the names of columns that others are lined up with
_CHANNEL = 14  # letters of "cmd_1 to cmd_8"


def info_lines(
    streams: Streams, options: ReadOptions | None = None, healthy: Mapping[str, float] | None = None
) -> Iterator[str]:
    """The lines of ``auv-log info`` for the log of a vehicle, compared with the parameters of a ``healthy`` flight."""
    options = options or ReadOptions()
    parameters = known(options.parameters, streams.vehicle.parameters)
    yield f"{streams.name}: {streams.format}, {streams.end - streams.start:.1f} s"
    yield from (f"  {key:<10} {text}" for key, text in _facts(streams, parameters))
    yield "  streams"
    yield from (f"    {_stream_line(stream)}" for stream in streams.streams.values())
    for finding in (*streams.findings, *options.findings, *_checked(streams, parameters, healthy)):
        yield f"  {finding}"
    yield from (f"  {line}" for line in _diagnosable(streams, options))


def _checked(streams: Streams, parameters: Mapping[str, float], healthy: Mapping[str, float] | None) -> list[Finding]:
    """What is wrong with the vehicle; nothing is looked for in one that does not go under water."""
    if other_kind(streams.vehicle.kinds):
        return []
    compared = compare_configuration(parameters, [healthy]) if healthy else []
    configured = check_configuration(streams, parameters)
    return [*check_kind(streams), *configured, *check_compass(streams, parameters), *compared]


def table_lines(table: Table, path: Path, vehicle: Vehicle | None = None, named: str = "...") -> Iterator[str]:
    """The same for a CSV or Parquet file: what each column is taken for, what is missing, and what a diagnosis needs.

    Where a ``vehicle`` is ``named``, the file is read as a diagnosis of that vehicle reads it.
    """
    understood = understand(table)
    yield f"{table.name}: table of {counted(len(table.row), 'row')}, {_duration(understood.table)}"
    yield "  columns"
    width = min(max(len(listed(taken.columns)) for taken in understood.taken), _WIDEST)
    for taken in understood.taken:
        channels = listed(taken.channels) or "-"
        yield f"    {listed(taken.columns):<{width}}  {channels:<{_CHANNEL}}  {taken.sentence}"
    if lacking := list(dict.fromkeys(what for _, what in missing(understood.table.columns, None))):
        yield f"  missing    {', '.join(lacking)}"
    extra = list(understood.refused)
    yield from (f"  {f}" for f in table.findings if not f.columns or set(f.columns) - set(extra))
    try:
        axes, findings = begins(understood, path, vehicle)
    except FlightLogError as error:
        yield f"  diagnosis  not yet: {error}"
        return
    yield from (f"  {finding}" for finding in findings)
    ignored = f", {counted(len(extra), 'column')} ignored" if extra else ""
    yield f"  diagnosis  of {' '.join(axes)}{ignored}"
    words = [f"log={path}", *([extra_of(extra)] if extra else [])]
    quoted = (printable(shlex.quote(word), None) for word in words)
    yield f"    python diagnose.py {' '.join(quoted)} vehicle={named}"


def _duration(table: Table) -> str:
    """Seconds of all episodes together, each from its first to its last row."""
    if "t" not in table.columns:
        return "no time"
    runs = runs_of_time(table, np.ones(len(table.row), bool), [])
    passed = sum(float(table.columns["t"][run[-1]] - table.columns["t"][run[0]]) for run in runs)
    return f"{counted(len(runs), 'episode')}, {passed:.1f} s" if runs else "no row with a time"


def _facts(streams: Streams, parameters: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    vehicle = streams.vehicle
    yield "firmware", vehicle.firmware or "not said"
    yield "frame", (vehicle.frame or "not said") + (f", {counted(vehicle.motors, 'motor')}" if vehicle.motors else "")
    if other := other_kind(vehicle.kinds):
        yield "vehicle", f"{other}: no underwater vehicle"
    else:
        yield "motors", _motors(streams, parameters)
    yield "parameters", str(len(vehicle.parameters))
    if streams.armed is None:
        yield "armed", "not said"
    else:
        total = sum(end - begin for begin, end in streams.armed)
        yield "armed", f"{total:.1f} s: {_spans(streams.armed)}" if streams.armed else "never"
    modes = [f"{mode} {begin:.1f} to {end:.1f} s" for begin, end, mode in streams.mode_spans()]
    yield "modes", (", ".join(modes[:_LISTED]) + (" ..." if len(modes) > _LISTED else "")) or "not said"
    power = streams.streams.get("battery")
    if power is not None:
        volts = power.values[:, 0]
        yield "battery", f"{np.nanmax(volts):.2f} to {np.nanmin(volts):.2f} V" if np.isfinite(volts).any() else "none"


def _motors(streams: Streams, parameters: Mapping[str, float]) -> str:
    if "commands" in streams.streams:
        return f"{len(streams.streams['commands'].channels)}, given as commands"
    if "outputs" not in streams.streams:
        return "no outputs"
    try:
        motors, missing = motors_of(parameters, streams.vehicle.motors)
    except FlightLogError as error:
        return str(error)
    if motors is None:
        return f"not said: {listed(missing)}"
    reverse = [str(n + 1) for n, direction in enumerate(motors.direction) if direction < 0]
    where = ", ".join(f"{n + 1} on {f'output {k}' if k else 'none'}" for n, k in enumerate(motors.output))
    return f"{where}; MOT_n_DIRECTION -1: {', '.join(reverse) or 'none'}; {motors.low:g} to {motors.high:g} us"


def _spans(spans: tuple[tuple[float, float], ...]) -> str:
    text = ", ".join(f"{begin:.1f} to {end:.1f} s" for begin, end in spans[:_LISTED])
    return text + (f" and {len(spans) - _LISTED} more" if len(spans) > _LISTED else "")


def _stream_line(stream: Stream) -> str:
    gaps = stream.gaps
    longest = max((end - begin for begin, end in gaps), default=0.0)
    without = f", {counted(len(gaps), 'gap')}, the longest of {longest:.1f} s" if gaps else ""
    logged = [name for i, name in enumerate(stream.channels) if np.isfinite(stream.values[:, i]).any()]
    span = logged if len(logged) < 5 else [logged[0], "...", logged[-1]]
    units = "/".join(unit for unit in dict.fromkeys(stream.units) if unit != "1")
    measured = f"{' '.join(span)} [{units}]" if units else " ".join(span)
    return (
        f"{stream.name:<14} {measured}, {stream.rate}, {counted(len(stream), 'sample')}{without}, "
        f"{stream.sampling}: {stream.source}"
    )


def _diagnosable(streams: Streams, options: ReadOptions) -> Iterator[str]:
    if other_kind(streams.vehicle.kinds):
        yield "diagnosis  none: only underwater vehicles are diagnosed"
        return
    try:
        table = tabulate(streams, options)
    except FlightLogError as error:
        yield f"diagnosis  not yet: {error}"
        return
    commands = [table.columns[name] for name in table.columns if name.startswith("cmd_")]
    if commands and max(float(np.nanmax(np.abs(each), initial=0.0)) for each in commands) < IDLE:
        yield "diagnosis  none: no thruster turns in it"
        return
    axes = [axis for axis in AXES if axis in table.columns]
    sources = choose(streams)
    yield f"diagnosis  {counted(len(table.row), 'row')} of {' '.join(axes)}"
    horizontal = {"x", "y"} <= set(axes) or {"u", "v"} <= set(axes)
    if not horizontal and {"ax", "ay"} <= set(axes):
        yield "           no position and no velocity: of surge and sway only what changes them is felt; no current"
    elif not horizontal:
        yield "           no position and no velocity: surge, sway and currents cannot be seen; horizontal thrusters"
        yield "           only by the turning that they make"
    if "z" not in axes and "w" not in axes:
        yield "           no depth: heave, buoyancy and load cannot be seen"
    if not {"roll", "pitch"} <= set(axes):
        yield "           no roll and pitch: the vehicle is taken to be level, or not, as the motion shows"
    if horizontal and sources.get("x") is not None and "u" not in axes:
        yield "           position is an estimate of a filter: small effects hide in its errors"
