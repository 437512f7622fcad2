"""From a file to a flight log: columns, rows, commands, episodes."""

import os
from collections.abc import Iterable

import numpy as np

from auv_torchrl.flightlog.columns import DEMANDS, Columns, choose_columns
from auv_torchrl.flightlog.log import POSE, VELOCITY, Episode, FlightLog, FlightLogError, Floats
from auv_torchrl.flightlog.rows import Stretch, usable_axes, usable_stretches
from auv_torchrl.flightlog.table import Table, read_table
from auv_torchrl.physics.kinematics import wrap_angle
from auv_torchrl.vehicle import Vehicle


def read_flightlog(path: str | os.PathLike[str], vehicle: Vehicle, extra: Iterable[str] = ()) -> FlightLog:
    """Read a CSV or Parquet log of this vehicle; what cannot be used is left out, and the findings say so.

    Args:
        path: the file.
        vehicle: nominal vehicle, empty batch; its mixer turns demands per degree of freedom into thruster commands.
        extra: columns to ignore.

    Raises:
        FlightLogError: if nothing of the file can be used.
    """
    table = read_table(path)
    columns = choose_columns(table.name, table.columns, vehicle.thrusters, extra)
    commands = thruster_commands(table, columns, vehicle)
    axes, findings = usable_axes(table, columns)
    if not axes:
        raise FlightLogError(f"{table.name} has no axis that can be used: {'; '.join(map(str, findings))}")
    stretches, more = usable_stretches(table, columns, axes, commands)
    findings = [*table.findings, *findings, *more]
    if not stretches:
        raise FlightLogError(f"{table.name} has no stretch that can be used: {'; '.join(map(str, findings))}")
    numbers = [stretch.episode for stretch in stretches]
    if len(set(numbers)) < len(numbers):
        numbers = list(range(len(stretches)))
    episodes = [_episode(table, axes, number, stretch) for number, stretch in zip(numbers, stretches, strict=True)]
    return FlightLog(table.name, tuple(episodes), axes, tuple(findings))


def thruster_commands(table: Table, columns: Columns, vehicle: Vehicle) -> Floats:
    """Commands of the thrusters (T, n), after mixer and clip."""
    if columns.commands[0] not in DEMANDS:
        return np.clip(np.stack([table.columns[name] for name in columns.commands], axis=-1), -1.0, 1.0)
    demand = np.zeros((len(table.row), len(DEMANDS)))
    for name in columns.commands:
        demand[:, DEMANDS.index(name)] = table.columns[name]
    mixer = vehicle.mixer.detach().cpu().double().numpy()
    return np.clip(demand @ mixer.T, -1.0, 1.0)


def _episode(table: Table, axes: tuple[str, ...], number: int, stretch: Stretch) -> Episode:
    rows = stretch.rows

    def measured(names: tuple[str, ...]) -> Floats:
        return np.stack([table.columns[n][rows] if n in axes else np.full(len(rows), np.nan) for n in names], axis=-1)

    pose = measured(POSE)
    pose[:, 3:] = wrap_angle(pose[:, 3:])
    battery = table.columns["battery"][rows] if "battery" in table.columns else None
    source = f"{table.name}, rows {table.row[rows[0]]} to {table.row[rows[-1]]}"
    return Episode(number, stretch.t, pose, measured(VELOCITY), stretch.commands, battery, source)
