"""How much of what a changed vehicle does differently a map of the commands can undo, from a flight of it."""

from collections.abc import Sequence

import numpy as np

from auv_torchrl.compensation.known_vehicle import Model
from auv_torchrl.flight import Flight
from auv_torchrl.physics import State, control_step
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.quantities import percent
from auv_torchrl.vehicle import CONTROLLED, Vehicle, index_of

_NONE = 0.002  # root mean square difference, shares of the full wrench, below which the motion is the nominal one
_MOST = 20_000  # steps looked at


def command_share(
    flight: Flight, nominal: Vehicle, control_dt: float, axes: Sequence[str] = CONTROLLED, speed: float = 0.0
) -> float | None:
    """Share of the unexplained acceleration that is an affine function of the command sent in the same step.

    Faults of thrusters are such functions and give nearly 1; a current, a delay or drag give little. None where the
    vehicle moves as the nominal one does: then what differs, if anything, is what its sensors report.

    Args:
        flight: of the changed vehicle, with the commands that were sent.
        nominal: one vehicle (empty batch).
        control_dt: s between its samples.
        axes: degrees of freedom that are controlled.
        speed: ahead in m/s, at which fins push.
    """
    model, controlled = Model.of(nominal), index_of(axes)

    def samples(name: str, first: int, last: int | None) -> np.ndarray:
        values = getattr(flight, name).double().numpy()[:, first:last]
        return values.reshape(-1, *values.shape[2:])

    position, quaternion, velocity, thrust, time = (
        samples(name, 0, -1) for name in ("position", "quaternion", "velocity", "thrust", "time")
    )
    command, reached = samples("command", 1, None), samples("velocity", 1, None)[:, controlled]
    known = np.isfinite(velocity).all(-1) & np.isfinite(reached).all(-1)
    rows = np.flatnonzero(known)[:: max(1, int(known.sum()) // _MOST)]
    sent = np.repeat(command[rows, None], 1 + int(np.ceil(float(model.c.delay) / control_dt)), axis=1)
    state = State(position[rows], quaternion[rows], velocity[rows], thrust[rows], sent, time[rows])
    expected = control_step(model.c, model.terms, state, command[rows], control_dt).velocity[:, controlled]
    reach = model.c.mass_inverse[controlled] @ wrench_per_share(model.c, model.terms, speed)
    most = control_dt * np.abs(reach).sum(-1)
    missed = (reached[rows] - expected) / most
    if np.sqrt(np.square(missed).mean()) < _NONE:
        return None
    inputs = np.concatenate((command[rows], np.ones((len(rows), 1))), axis=-1)
    left = missed - inputs @ np.linalg.lstsq(inputs, missed, rcond=1e-9)[0]
    return float(1.0 - np.square(left).sum() / np.square(missed).sum())


def command_sentence(share: float | None) -> str:
    """What it comes to, for the console."""
    if share is None:
        return (
            "It moves as the nominal vehicle does: what differs, if anything, is what its sensors report, "
            "and no map of the commands can undo that."
        )
    undone = f"A map of the commands can undo {percent(share)} of what it does differently"
    if share > 0.9:
        return f"{undone}."
    return f"{undone}; the rest needs the effect itself in the loop: diagnose=true finds it and puts it there."
