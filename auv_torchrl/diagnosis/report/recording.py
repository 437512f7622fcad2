"""diagnosis.rrd: the held-out windows one after the other, with the vehicle measured, before and after side by side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from auv_torchrl.diagnosis.verdict import Diagnosis, Trajectory, Window
from auv_torchrl.flightlog import POSE, VELOCITY
from auv_torchrl.flightlog.log import AXES, Floats
from auv_torchrl.palette import NEUTRAL, U_S, U_T, rgb
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.kinematics import matvec, quaternion_from_euler, rotation_matrix
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.recording.body import record_hull, record_motion
from auv_torchrl.recording.file import write_recording
from auv_torchrl.text import printable
from auv_torchrl.vehicle import Vehicle

COLOUR = {"measured": NEUTRAL, "before": U_S, "after": U_T}
PAUSE_S = 0.5  # between windows on the common timeline


def record_diagnosis(diagnosis: Diagnosis, vehicle: Vehicle, path: Path) -> None:
    """Write a recording of the windows of a diagnosis, over one that there is.

    Args:
        diagnosis: with its windows.
        vehicle: the nominal vehicle, no batch.
        path: of the .rrd file.
    """
    seen = [axis for axis in (*POSE, *VELOCITY) if any(_measured(window, axis) for window in diagnosis.windows)]
    with rr.RecordingStream("auv_torchrl diagnose") as recording:
        memory = recording.memory_recording()
        recording.send_blueprint(_blueprint(seen), make_active=False)
        recording.log("world", rr.ViewCoordinates.FRD, static=True)  # x north, y east, z down
        about = f"# {diagnosis.verdict.key.replace('_', ' ')}\n\n{printable(diagnosis.summary, None)}\n\n" + "\n".join(
            f"- {effect.clause}" for effect in diagnosis.effects
        )
        recording.log("about", rr.TextDocument(about, media_type=rr.MediaType.MARKDOWN), static=True)
        if diagnosis.windows:
            _record_windows(recording, diagnosis.windows, vehicle, seen)
        write_recording(memory, path)


def _record_windows(
    recording: rr.RecordingStream, windows: Sequence[Window], vehicle: Vehicle, seen: list[str]
) -> None:
    starts = np.cumsum([0.0, *(window.t[-1] - window.t[0] + PAUSE_S for window in windows)])
    time = np.concatenate([window.t - window.t[0] + start for window, start in zip(windows, starts, strict=False)])
    commands = np.concatenate([window.commands for window in windows])
    coefficients = prepare(vehicle)
    thrust = thrust_target(coefficients, ActiveTerms.of(coefficients), commands)  # of a nominal vehicle
    for name, colour in COLOUR.items():
        trajectories: list[Trajectory] = [getattr(window, name) for window in windows]
        poses = [_shown_pose(w.t, trajectory) for w, trajectory in zip(windows, trajectories, strict=True)]
        record_hull(recording, f"world/{name}", vehicle, colour)
        pose, clock = np.concatenate(poses), rr.TimeColumn("time", duration=time)
        turned = quaternion_from_euler(*pose[:, 3:].T)
        record_motion(recording, f"world/{name}", vehicle, clock, pose[:, :3], turned, thrust)
        paths = rr.LineStrips3D([pose[:, :3] for pose in poses], colors=[rgb(colour)], radii=0.006)
        recording.log(f"world/paths/{name}", paths, static=True)
        values = np.concatenate([trajectory.values for trajectory in trajectories])
        for axis in seen:
            entity = f"axes/{axis}/{name}"
            style = rr.SeriesLines(names=[name], colors=[rgb(colour)], widths=[2.0])
            recording.log(entity, style, static=True)
            column = values[:, AXES.index(axis)]
            recording.send_columns(entity, [rr.TimeColumn("time", duration=time)], rr.Scalars.columns(scalars=column))


def _measured(window: Window, axis: str) -> bool:
    return bool(np.isfinite(window.measured.values[:, AXES.index(axis)]).any())


def _shown_pose(t: Floats, trajectory: Trajectory) -> Floats:
    """Pose (T, 6) to draw: angles that are not measured are 0, a position that is not measured follows the velocity."""
    pose = trajectory.pose.copy()
    velocity = np.nan_to_num(trajectory.velocity)
    steps = np.diff(t, prepend=t[0])[:, None]
    if np.isnan(pose[:, 5]).any():
        pose[:, 5] = np.cumsum(velocity[:, 5] * steps[:, 0])
    pose[:, 3:] = np.nan_to_num(pose[:, 3:])
    if np.isnan(pose[:, :3]).any():
        earth = matvec(rotation_matrix(quaternion_from_euler(*pose[:, 3:].T)), velocity[:, :3])
        pose[:, :3] = np.where(np.isnan(pose[:, :3]), np.cumsum(earth * steps, axis=0), pose[:, :3])
    return pose


def _blueprint(axes: list[str]) -> rrb.Blueprint:
    scene = rrb.Spatial3DView(origin="world", name="measured grey, before red, after blue; NED in m")
    plots = [rrb.TimeSeriesView(origin=f"axes/{axis}", name=axis) for axis in axes]
    about = rrb.TextDocumentView(origin="about", name="Diagnosis")
    left = rrb.Vertical(scene, about, row_shares=[3, 1])
    right = rrb.Grid(*plots, grid_columns=2 if len(plots) > 4 else 1) if plots else about
    return rrb.Blueprint(rrb.Horizontal(left, right), rrb.TimePanel(state="collapsed", timeline="time"))
