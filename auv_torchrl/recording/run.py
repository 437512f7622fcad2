"""run.rrd: the flights of one run of train.py, to look at in the rerun viewer."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr

from auv_torchrl.flight import Flight
from auv_torchrl.palette import CONTROLLER, SERIES, rgb
from auv_torchrl.recording.blueprint import run_blueprint
from auv_torchrl.recording.body import record_vehicle
from auv_torchrl.recording.file import write_recording
from auv_torchrl.recording.flight import OneFlight, record_flight
from auv_torchrl.recording.series import record_reference, record_series, thruster_series
from auv_torchrl.vehicle import CONTROLLED, Vehicle, index_of
from auv_torchrl.vehicle.tensors import tensors

PATHS = 24  # starts whose path is drawn
VEHICLES = 2  # starts whose vehicle moves along it
AXES_M = 0.4  # length of the axes at the origin


@dataclass(frozen=True)
class ControlMap:
    """What the adaptation learnt, linear about rest: demand on the target = matrix @ demand on the source + offset."""

    matrix: np.ndarray  # (k, a) per unit of each channel
    offset: np.ndarray  # (k,)
    rows: tuple[str, ...]  # names of the k outputs
    axes: tuple[str, ...] = CONTROLLED  # of the a channels

    def markdown(self) -> str:
        """As a table of numbers."""
        head = "| target | " + " | ".join(self.axes) + " | offset |\n|---|" + "---:|" * (len(self.axes) + 1)
        lines = [
            f"| **{name}** | " + " | ".join(f"{value:+.2f}" for value in row) + f" | {offset:+.2f} |"
            for name, row, offset in zip(self.rows, self.matrix, self.offset, strict=True)
        ]
        return "\n".join(["# The map H: source demand to target demand", "", head, *lines])


def record_run(
    path: Path,
    flights: Mapping[str, Flight],
    vehicles: Mapping[str, Vehicle],
    about: str,
    control_map: ControlMap | None = None,
    one_flight: OneFlight | None = None,
    replace: bool = False,
    axes: tuple[str, ...] = CONTROLLED,
) -> None:
    """Write the flights to ``path`` with a blueprint, so that the viewer opens arranged.

    Args:
        path: of the .rrd file.
        flights: ``nominal``, ``u_s`` and ``u_t``, as far as they were flown, from the same starts, batch (N, T + 1).
        vehicles: the vehicle (no batch) that each of them flew.
        about: markdown with the result, shown beside the scene.
        control_map: the map, where one was learnt.
        one_flight: in which the vehicle changes, where one was flown.
        replace: the file if there is one; otherwise there must be none.
        axes: that the policy commands.

    Raises:
        FileExistsError: if there is such a file and it is not to be replaced.
    """
    if path.exists() and not replace:
        raise FileExistsError(f"the recording {path} exists already: give another output folder or delete it")
    shown = _starts_to_show(flights)
    first = next(iter(flights.values()))
    reach = float(max(path[shown].norm(dim=-1).max() for path in (first.position[:, :1], first.reference_position)))
    driven = "u_t" if "u_t" in flights else list(flights)[-1]
    commands = control_map.rows if control_map is not None else _command_names(flights[driven], axes)
    with rr.RecordingStream("auv_torchrl train") as recording:
        memory = recording.memory_recording()
        blueprint = run_blueprint(list(flights), commands, reach, one_flight is not None)
        recording.send_blueprint(blueprint, make_active=False)
        recording.log("world", rr.ViewCoordinates.FRD, static=True)  # x north, y east, z down
        recording.log("about", rr.TextDocument(about, media_type=rr.MediaType.MARKDOWN), static=True)
        _record_target(recording)
        record_reference(recording, "world/target", first.of_start(shown[0]))
        for name, flight in flights.items():
            _record_paths(recording, name, flight, shown)
            _record_error(recording, name, flight, shown[0])
            _record_thrust(recording, name, flight.of_start(shown[0]))
            for number, start in enumerate(shown[:VEHICLES], start=1):
                entity = f"world/{name}/start_{number}"
                record_vehicle(recording, entity, vehicles[name], flight.of_start(start), CONTROLLER[name])
        _record_commands(recording, flights[driven].of_start(shown[0]), vehicles[driven], commands, axes)
        if control_map is not None:
            _record_map(recording, control_map)
        if one_flight is not None:
            record_flight(recording, one_flight)
        write_recording(memory, path)


def _starts_to_show(flights: Mapping[str, Flight]) -> list[int]:
    """The start that stays farthest from the target under u_s, then others in their random order."""
    pictured = flights.get("u_s", next(iter(flights.values())))
    worst = int(pictured.position_error.mean(dim=1).argmax())
    others = [start for start in range(pictured.shape[0]) if start != worst]
    return [worst, *others][:PATHS]


def _record_target(recording: rr.RecordingStream) -> None:
    colours = [rgb(SERIES[5]), rgb(SERIES[2]), rgb(SERIES[4])]
    axes = rr.Arrows3D(vectors=AXES_M * np.eye(3), colors=colours, radii=0.01)
    recording.log("world/target", axes, static=True)
    tips = rr.Points3D(1.15 * AXES_M * np.eye(3), radii=0.0, colors=colours, labels=["N", "E", "D"], show_labels=True)
    recording.log("world/target/axes", tips, static=True)


def _record_paths(recording: rr.RecordingStream, name: str, flight: Flight, shown: list[int]) -> None:
    strips = flight.position[shown, ::2].float().numpy()
    recording.log(
        f"world/{name}/paths",
        rr.LineStrips3D(
            list(strips), colors=[rgb(CONTROLLER[name], 255 if i < VEHICLES else 110) for i in range(len(strips))],
            radii=[0.008 if i < VEHICLES else 0.003 for i in range(len(strips))],
        ),
        static=True,
    )  # fmt: skip


def _record_error(recording: rr.RecordingStream, name: str, flight: Flight, start: int) -> None:
    error = flight.position_error.double()
    curves = {"start 1": error[start], "worst": error.amax(dim=0)}
    width = {"start 1": 2.5, "worst": 1.0}
    for curve, values in curves.items():
        entity = f"error/{name}/{curve.replace(' ', '_')}"
        colour = rgb(CONTROLLER[name], 140 if curve == "worst" else 255)
        series = values.numpy()[:, None]
        record_series(recording, entity, flight.of_start(start), series, [f"{name}, {curve}"], [colour], width[curve])


def _record_thrust(recording: rr.RecordingStream, name: str, flight: Flight) -> None:
    names, colours = thruster_series(flight.thrust.shape[-1])
    record_series(recording, f"thrust/{name}", flight, flight.thrust.double().numpy(), names, colours)


def _command_names(flight: Flight, axes: tuple[str, ...]) -> tuple[str, ...]:
    """The channels where commands are as many, else the thrusters."""
    if flight.applied_action.shape[-1] == len(axes):
        return axes
    return tuple(f"thruster_{i + 1}" for i in range(flight.applied_action.shape[-1]))


def _record_commands(
    recording: rr.RecordingStream, flight: Flight, vehicle: Vehicle, names: tuple[str, ...], axes: tuple[str, ...]
) -> None:
    before = flight.action.double()
    if names != axes and before.shape[-1] == len(axes):
        mixer = tensors(vehicle).mixer[:, index_of(axes)]
        before = (before @ mixer.T).clamp(-1, 1)
    both = {"before": (before, CONTROLLER["u_s"]), "after": (flight.applied_action.double(), CONTROLLER["u_t"])}
    for i, name in enumerate(names):
        for when, (command, colour) in both.items():
            values = command[:, i : i + 1].numpy()
            entity = f"commands/{name}/{when}"
            record_series(recording, entity, flight, values, [f"{when} the map"], [rgb(colour)])


def _record_map(recording: rr.RecordingStream, control_map: ControlMap) -> None:
    text = rr.TextDocument(control_map.markdown(), media_type=rr.MediaType.MARKDOWN)
    recording.log("map/text", text, static=True)
    tensor = rr.Tensor(control_map.matrix.astype(np.float32), dim_names=("target demand", "source demand"))
    recording.log("map/matrix", tensor, static=True)
