"""From streams to rows: every stream at the times at which commands change, as the checks of a table expect it.

Rows are where commands begin to act. Snapshots of something faster are taken to act from half a step before to half a
step after, since held from snapshot to snapshot they would be half a step late; where sensors were read with them, a
row stands at the snapshot too, and what was measured counts in these rows alone. What is sampled faster than the rows
is averaged around each, what is slower is interpolated; nothing is filled in across a pause, and what was not measured
stays NaN.
"""

from collections.abc import Mapping

import numpy as np

from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity
from auv_torchrl.flightlog.log import ACCELERATION, ANGLES, AXES, POSE, VELOCITY, SampleErrors
from auv_torchrl.flightlog.streams.compass import check_compass
from auv_torchrl.flightlog.streams.configuration import check_configuration
from auv_torchrl.flightlog.streams.drift import drift_of
from auv_torchrl.flightlog.streams.motors import commands_of
from auv_torchrl.flightlog.streams.parameters import known
from auv_torchrl.flightlog.streams.stream import Floats, ReadOptions, Sampling, Spans, Stream, Streams
from auv_torchrl.flightlog.streams.vehicle_kind import check_kind
from auv_torchrl.flightlog.tables.table import MAX_ROWS, Table
from auv_torchrl.physics import CONTROL_DT

SOURCES = {  # of each column, the best first: raw sensors before the estimates of a filter
    "x": ("position",), "y": ("position",), "z": ("depth", "position"),
    "roll": ("attitude",), "pitch": ("attitude",), "yaw": ("attitude",),
    "u": ("dvl", "body_velocity"), "v": ("dvl", "body_velocity"), "w": ("dvl", "body_velocity"),
    "p": ("gyro",), "q": ("gyro",), "r": ("gyro",),
    **dict.fromkeys(ACCELERATION, ("accelerometer",)),
}  # fmt: skip
_FASTER = 0.6  # of the interval of the rows: streams whose interval is shorter are averaged
_ROUNDING_S = 1e-6  # s, of times in a file: what lies on the edge of a window is left out on both sides
_MOMENT_S = 0.5  # s, within which the streams of a log begin and end
_MOST_PARTS = 20  # rows into which the time of one command is divided
_TOGETHER = 0.1  # of the interval of the rows, within which a sample was taken at a row
_IN_STEP = 0.4  # share of the rows with a sample from which sensors are read in step with the commands


def tabulate(streams: Streams, options: ReadOptions | None = None) -> Table:
    """One table of all that the diagnosis can use; every armed stretch, in the modes wanted, is an episode.

    Raises:
        FlightLogError: if it was written by another kind of vehicle, there are no commands, the vehicle was never
            armed, or never flew in the modes wanted.
    """
    options = options or ReadOptions()
    mixed = check_kind(streams)
    autopilot = known(options.parameters, streams.vehicle.parameters)
    commands = commands_of(streams, autopilot)
    chosen = choose(streams)
    if not chosen:
        raise FlightLogError(
            f"{streams.name} measures nothing that a diagnosis can use (it has {', '.join(streams.streams)}): log "
            "attitude, depth, gyro, position or velocity"
        )
    attitude = _attitude(chosen)
    t, row = row_times(commands, _wanted_interval(commands, attitude))
    number, findings = _episodes(streams, options, t)
    kept = (number >= 0) & ~_before_or_after(t, chosen)
    t, row, number = t[kept], row[kept], number[kept]
    if len(t) > MAX_ROWS:
        raise FlightLogError(f"{streams.name} has more than {MAX_ROWS:,} commands: give a part of it")
    columns: dict[str, Floats] = {"t": t, "episode": number.astype(np.float64)}
    interval = float(np.median(np.diff(t))) if len(t) > 1 else CONTROL_DT
    for axis, stream in chosen.items():
        column = sampled(stream, axis, t, interval)
        if np.isfinite(column).any():
            columns[axis] = column
    findings += _sources(commands, chosen, columns)
    columns.update({name: commands.values[row, i] for i, name in enumerate(commands.channels)})
    if "battery" in streams.streams:
        columns["battery"] = sampled(streams.streams["battery"], "voltage", t, interval)
    findings += [*mixed, *options.findings, *check_configuration(streams, autopilot)]
    findings += check_compass(streams, autopilot)
    return Table(
        streams.name, columns, np.arange(1, len(t) + 1), (*streams.findings, *findings), units_known=True,
        measured=_measured_rows(attitude, t, interval), errors=_errors(streams, commands, chosen), autopilot=autopilot,
    )  # fmt: skip


def _errors(streams: Streams, commands: Stream, chosen: Mapping[str, Stream]) -> SampleErrors:
    """What the streams say of errors that are no white noise."""
    snapshot = commands.interval if commands.sampling is Sampling.SNAPSHOT and len(commands) > 1 else 0.0
    rates = {axis: drift_of(stream, streams.streams.get("gyro")) for axis, stream in chosen.items()}
    return SampleErrors(snapshot, {axis: rate for axis, rate in rates.items() if rate > 0})


def _measured_rows(attitude: Stream, t: Floats, interval: float) -> np.ndarray | None:
    """(T,) rows at which ``attitude`` has a sample, where it is sampled in step with them; None where it is not."""
    if len(attitude) < 2 or len(t) < 2:
        return None
    after = np.clip(np.searchsorted(attitude.t, t), 1, len(attitude) - 1)
    here = np.minimum(np.abs(attitude.t[after] - t), np.abs(attitude.t[after - 1] - t)) < _TOGETHER * interval
    return here if _IN_STEP < here.mean() < 1 - _IN_STEP else None


def choose(streams: Streams) -> dict[str, Stream]:
    """The stream of each column that there is one for."""
    found = {}
    for axis in AXES:
        for name in SOURCES[axis]:
            stream = streams.streams.get(name)
            if stream is None or axis not in stream.channels:
                continue
            if np.isfinite(stream.values[:, stream.channels.index(axis)]).any():
                found[axis] = stream
                break
    return found


def row_times(commands: Stream, interval: float) -> tuple[Floats, np.ndarray]:
    """When rows begin (T,), about ``interval`` s apart, and the sample of ``commands`` that acts in each (T,)."""
    t, step = commands.t, commands.interval if len(commands) > 1 else interval
    begin = t.copy()
    if commands.sampling is Sampling.SNAPSHOT:
        before = np.concatenate(([np.inf], np.diff(t)))
        begin = t - np.where(before > commands.pause, step, before) / 2 if len(t) > 1 else t
    parts = min(_MOST_PARTS, max(1, round(step / interval))) if len(t) > 1 else 1
    if commands.sampling is Sampling.SNAPSHOT and parts % 2 and step > 1.5 * CONTROL_DT * parts:
        parts *= 2  # a row at the snapshot itself
    if parts == 1:
        return begin, np.arange(len(t))
    length = np.concatenate((np.diff(begin), [step]))
    length = np.where(length > commands.pause, step, length)
    rows = begin[:, None] + length[:, None] * np.arange(parts) / parts
    return rows.ravel(), np.repeat(np.arange(len(t)), parts)


def sampled(stream: Stream, channel: str, t: Floats, interval: float) -> Floats:
    """A channel at the times ``t`` (T,): averaged over ``interval`` s if sampled faster, else interpolated."""
    values = stream.values[:, stream.channels.index(channel)]
    known = np.isfinite(values)
    times, values = stream.t[known], values[known]
    if len(times) < 2:
        return np.full(len(t), np.nan)
    angle = channel in ANGLES
    if angle:
        values = np.unwrap(values)
    after = np.clip(np.searchsorted(times, t), 1, len(times) - 1)
    near = (t >= times[0]) & (t <= times[-1]) & (times[after] - times[after - 1] <= stream.pause)
    result = np.interp(t, times, values)
    if stream.interval < _FASTER * interval:
        edge = interval / 2 - _ROUNDING_S
        low, high = np.searchsorted(times, t - edge), np.searchsorted(times, t + edge, side="right")
        some = high > low
        level = values.mean()  # off, so that the sums stay exact
        total = np.concatenate(([0.0], np.cumsum(values - level)))
        result = np.where(some, level + (total[high] - total[low]) / np.maximum(high - low, 1), result)
    result = np.where(near, result, np.nan)
    return np.arctan2(np.sin(result), np.cos(result)) if angle else result


def _attitude(chosen: Mapping[str, Stream]) -> Stream:
    """The attitude, or else what is told most often."""
    return chosen.get("yaw") or chosen.get("roll") or min(chosen.values(), key=lambda stream: stream.interval)


def _wanted_interval(commands: Stream, attitude: Stream) -> float:
    """As often as ``attitude``; never more often than a control step."""
    return max(CONTROL_DT, attitude.interval) if len(attitude) > 1 else max(CONTROL_DT, commands.interval)


def _before_or_after(t: Floats, chosen: Mapping[str, Stream]) -> np.ndarray:
    """The moment in which sensors begin and end one after the other; more than that is a sensor that was not there."""
    first, last = max(s.t[0] for s in chosen.values()), min(s.t[-1] for s in chosen.values())
    return ((t < first) & (t > first - _MOMENT_S)) | ((t > last) & (t < last + _MOMENT_S))


def _episodes(streams: Streams, options: ReadOptions, t: Floats) -> tuple[np.ndarray, list[Finding]]:
    """The episode of each row, -1 for rows to leave out."""
    findings = []
    flown = np.ones(len(t), bool)
    if streams.armed is None:
        sentence = "the file does not say when the vehicle was armed; all of it is taken"
        findings.append(Finding(Severity.INFO, "arming_unknown", sentence, "Log ARM, EV or HEARTBEAT"))
    else:
        flown = within(t, streams.armed)
        if not flown.any():
            raise FlightLogError(
                f"{streams.name}: the vehicle was not armed while commands were logged, so that nothing can be told of "
                "its thrusters: give the log of a dive"
            )
    if options.modes:
        spans = streams.mode_spans()
        there = sorted({mode for *_, mode in spans})
        if unknown := [mode for mode in options.modes if mode not in there]:
            raise FlightLogError(
                f"{streams.name} was not flown in {', '.join(unknown)}: give modes out of {', '.join(there) or 'none'}"
            )
        flown &= within(t, tuple((a, b) for a, b, mode in spans if mode in options.modes))
        if not flown.any():
            raise FlightLogError(f"{streams.name} was not armed in {', '.join(options.modes)}: give other modes")
    begins = flown & ~np.concatenate(([False], flown[:-1]))
    return np.where(flown, np.cumsum(begins) - 1, -1), findings


def within(t: Floats, spans: Spans) -> np.ndarray:
    """Whether each time lies in one of the spans."""
    inside = np.zeros(len(t), bool)
    for begin, end in spans:
        inside |= (t >= begin) & (t < end)
    return inside


def _sources(commands: Stream, chosen: Mapping[str, Stream], columns: Mapping[str, Floats]) -> list[Finding]:
    """What each column was read from, and what is not there."""
    by_source: dict[str, list[str]] = {}
    for axis, stream in chosen.items():
        if axis in columns:
            by_source.setdefault(f"{stream.source} ({stream.rate})", []).append(axis)
    sources = [f"{' '.join(axes)} from {source}" for source, axes in by_source.items()]
    centred = ", taken as snapshots" if commands.sampling is Sampling.SNAPSHOT else ""
    sources.append(f"commands from {commands.source} ({commands.rate}{centred})")
    findings = [Finding(Severity.INFO, "sources", "; ".join(sources))]
    lacking = tuple(axis for axis in POSE + VELOCITY if axis not in columns)
    if lacking:
        findings.append(
            Finding(Severity.INFO, "not_measured", f"{', '.join(lacking)} are not in the file", "", lacking)
        )
    return findings
