"""From a file to a flight log: columns, rows, commands, episodes, checks."""

import os
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from auv_torchrl.flightlog.checks.clock import check_clock
from auv_torchrl.flightlog.checks.contact import leave_out_contact
from auv_torchrl.flightlog.checks.degrees import convert_degrees
from auv_torchrl.flightlog.checks.excitation import check_excitation
from auv_torchrl.flightlog.checks.frames import check_frames
from auv_torchrl.flightlog.checks.gravity import check_gravity
from auv_torchrl.flightlog.checks.information import Checked, check_information
from auv_torchrl.flightlog.checks.units import check_commands, check_time_unit
from auv_torchrl.flightlog.findings import Finding, FlightLogError, Severity, condensed, quoted
from auv_torchrl.flightlog.log import ACCELERATION, AXES, POSE, VELOCITY, Episode, FlightLog, Floats
from auv_torchrl.flightlog.readers import read_log
from auv_torchrl.flightlog.streams import ReadOptions, tabulate
from auv_torchrl.flightlog.streams.parameters import known
from auv_torchrl.flightlog.streams.vehicle_file import check_frame
from auv_torchrl.flightlog.tables.columns import DEMANDS, choose_columns
from auv_torchrl.flightlog.tables.rows import Stretch, usable_axes, usable_stretches
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.flightlog.understand import Understood, understand
from auv_torchrl.physics.kinematics import wrap_angle
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle


def read_flightlog(
    path: str | os.PathLike[str], vehicle: Vehicle, extra: Iterable[str] = (), options: ReadOptions | None = None
) -> FlightLog:
    """Read a log of this vehicle; what cannot be used is left out, and the findings say so.

    CSV and Parquet are the simple form; other formats are those of :data:`auv_torchrl.flightlog.readers.READERS`.

    Args:
        path: the file.
        vehicle: nominal vehicle, empty batch; its mixer turns demands per degree of freedom into thruster commands.
        extra: columns to ignore.
        options: what people add to the log of a vehicle: modes, parameters that it lacks.

    Raises:
        FlightLogError: if nothing of the file can be used.
    """
    understood = understand(without(_table(path, vehicle, options), extra))
    usable = find_usable(understood, vehicle.thrusters, vehicle.mixer)
    table, axes, stretches, checked, findings = usable
    numbers = [stretch.episode for stretch in stretches]
    if len(set(numbers)) < len(numbers):
        numbers = list(range(len(stretches)))
    numbered = zip(numbers, stretches, strict=True)
    filled = _not_measured(table, checked.filled)
    episodes = tuple(_episode(table, axes, number, stretch, filled) for number, stretch in numbered)
    clock = [] if table.units_known else check_clock(episodes, vehicle)
    findings += clock
    seconds = not any(finding.severity is Severity.ERROR for finding in clock)  # rates in another unit show nothing
    if seconds and not table.units_known:
        episodes, more = convert_degrees(episodes, axes, vehicle, understood.settled)
        findings += more
    episodes = tuple(_wrapped(episode) for episode in episodes)
    if seconds:
        episodes, axes, more = check_frames(episodes, axes, vehicle, table.units_known, bool(table.autopilot))
        findings += more
    episodes, axes, more = check_gravity(episodes, axes, table.units_known)
    findings += more
    if "z" in axes:
        episodes, more = leave_out_contact(episodes, vehicle)
        findings += more
    findings += check_excitation(episodes)
    noted = tuple(condensed(findings))
    return FlightLog(
        printable(table.name), episodes, axes, noted, checked.resolution, table.errors, known(table.autopilot)
    )


def without(table: Table, extra: Iterable[str]) -> Table:
    """The table without the columns that are to be ignored."""
    ignored = set(extra)
    findings = tuple(finding for finding in table.findings if not finding.columns or set(finding.columns) - ignored)
    columns = {name: column for name, column in table.columns.items() if name not in ignored}
    return replace(table, columns=columns, findings=findings)


class Usable(NamedTuple):
    """What of a table can be used."""

    table: Table  # with doubtful values filled in
    axes: tuple[str, ...]  # measured
    stretches: list[Stretch]  # one at least
    checked: Checked
    findings: list[Finding]


def find_usable(understood: Understood, thrusters: int | None = None, mixer: Floats | None = None) -> Usable:
    """Which columns and rows can be used.

    Args:
        understood: the table.
        thrusters: of the vehicle; None takes as many as there are commands.
        mixer: (n, 6) of the vehicle, for demands; None takes these as they are, to count rows alone.

    Raises:
        FlightLogError: if none can.
    """
    table = understood.table
    axes, commanded = choose_columns(table.name, table.columns, thrusters, understood.refused)
    check_time_unit(table.name, table.columns["t"])
    sent = np.stack([table.columns[name] for name in commanded], axis=-1)
    findings = [*table.findings, *check_commands(table.name, commanded, sent, table.row)]
    commands = _thruster_commands(sent, commanded, mixer)
    axes, more = usable_axes(table, axes)
    findings += more
    checked = check_information(table, axes, commands)
    findings += checked.findings
    axes = tuple(axis for axis in axes if axis in checked.columns)
    table = replace(table, columns={**table.columns, **checked.columns})
    stretches: list[Stretch] = []
    if axes:
        stretches, more = usable_stretches(table, commanded, axes, commands, checked.cuts)
        findings += more
    if not stretches:
        why = quoted(finding for finding in findings if finding.severity is not Severity.INFO)
        raise FlightLogError(f"{table.name} has nothing that can be used: {why}")
    return Usable(table, axes, stretches, checked, findings)


def _table(path: str | os.PathLike[str], vehicle: Vehicle, options: ReadOptions | None) -> Table:
    log = read_log(path, options)
    if isinstance(log, Table):
        return log
    table = tabulate(log, options)
    return replace(table, findings=(*table.findings, *check_frame(log, table, vehicle)))


def _thruster_commands(sent: Floats, names: tuple[str, ...], mixer: Floats | None) -> Floats:
    """Commands of the thrusters (T, n), after mixer and clip, from the columns ``sent`` (T, k) of these names."""
    if names[0] not in DEMANDS or mixer is None:
        return np.clip(sent, -1.0, 1.0)
    return np.clip(sent @ mixer[:, [DEMANDS.index(name) for name in names]].T, -1.0, 1.0)


def _not_measured(table: Table, filled: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """By axis, the rows whose values are filled in: doubtful ones, and rows that are there for a command alone."""
    if table.measured is None:
        return filled
    return {axis: mask | ~table.measured for axis, mask in filled.items()}


def _episode(
    table: Table, axes: tuple[str, ...], number: int, stretch: Stretch, filled: dict[str, np.ndarray]
) -> Episode:
    nothing = np.zeros(len(table.row), bool)
    doubt = {axis: filled.get(axis, nothing) for axis in axes}

    def measured(names: tuple[str, ...]) -> Floats:
        unseen = np.full(len(stretch.t), np.nan)
        columns = [stretch.mean(table.columns[n], doubt[n]) if n in axes else unseen for n in names]
        return np.stack(columns, axis=-1)

    def share(name: str) -> Floats:
        return doubt[name][stretch.around].all(axis=-1).astype(float) if name in axes else np.zeros(len(stretch.t))

    felt = bool(set(axes) & set(ACCELERATION))
    some = any(mask[stretch.around].any() for mask in doubt.values())
    shares = np.stack([share(name) for name in (AXES if felt else POSE + VELOCITY)], axis=-1) if some else None

    battery = stretch.mean(table.columns["battery"]) if "battery" in table.columns else None
    source = f"{table.name}, rows {table.row[stretch.rows[0]]} to {table.row[stretch.rows[-1]]}"
    return Episode(
        number, stretch.t, measured(POSE), measured(VELOCITY), stretch.commands, battery, source, shares, stretch.parts,
        measured(ACCELERATION) if felt else None,
    )  # fmt: skip


def _wrapped(episode: Episode) -> Episode:
    pose = episode.pose.copy()
    pose[:, 3:] = wrap_angle(pose[:, 3:])
    return replace(episode, pose=pose)
