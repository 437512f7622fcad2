"""What a vehicle does when it is told to go one way: what its coefficients mean to a pilot.

Drag, thrust and inertia of a vehicle trade against each other; how fast it goes, how soon, and where it goes although
nobody asked, do not.
"""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.diagnosis.identify.attitude import held_level
from auv_torchrl.diagnosis.motion.rollout import DIVERGING
from auv_torchrl.diagnosis.motion.windows import Floats
from auv_torchrl.diagnosis.thresholds import NOTICED, NOTICED_DRIFT, NOTICED_TURN
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import quantity
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle

LASTS_S = 10.0  # s, after which a vehicle of this size goes steadily
RISEN = 0.632  # of the steady speed: the time constant
LEAST = 1e-3  # m/s, rad/s, s: one that does not go at all differs by so many times, not by infinitely many
WORDS = {"surge": "forward", "sway": "sideways", "heave": "down", "yaw": "turning"}


@dataclass(frozen=True)
class Response:
    """Steady velocity (5, 6) under no command and under each of the four, and the time (5,) to get there."""

    steady: Floats
    time_s: Floats


@DIVERGING
def respond(vehicle: Vehicle, command: float) -> Response:
    """Step commands from rest, one controlled degree of freedom at a time; roll and pitch are held level."""
    sent = np.zeros((1 + len(CONTROLLED), vehicle.thrusters))
    sent[1:] = np.clip(command * vehicle.mixer.numpy()[:, CONTROLLED_INDEX].T, -1, 1)
    rows, times = len(sent), CONTROL_DT * np.arange(1 + round(LASTS_S / CONTROL_DT))
    held = np.repeat(sent[:, None], len(times) - 1, axis=1)
    velocity = simulate(held_level(vehicle), held, times).states[:, 1:, 7:].swapaxes(0, 1)  # (T, rows, 6)
    steady = velocity[-1]
    own = np.array([2, *CONTROLLED_INDEX])  # idle, it can only rise or sink
    along = np.abs(velocity[:, np.arange(rows), own])
    return Response(steady, (1 + np.argmax(along >= RISEN * along[-1], axis=0)) * CONTROL_DT)


@DIVERGING
def differences(before: Response, after: Response, command: float) -> dict[str, tuple[str, ...]]:
    """Sentences by subject (``axes``, ``idle``, ``turning``) about what ``after`` does unlike ``before``.

    The axis that differs most stands first.
    """
    axes: list[tuple[float, str]] = []
    for row, (name, degree) in enumerate(zip(CONTROLLED, CONTROLLED_INDEX, strict=True), start=1):
        unit = "rad/s" if degree > 2 else "m/s"
        speed = [abs(response.steady[row, degree]) for response in (before, after)]
        time = [response.time_s[row] for response in (before, after)]
        if abs(speed[1] / speed[0] - 1) > NOTICED or abs(time[1] / time[0] - 1) > NOTICED:
            filed, found = (quantity(value, unit, 2) for value in speed)
            sentence = (
                f"{WORDS[name]} it does {found} at command {command:g}, and gets there with a time "
                f"constant of {time[1]:.1f} s (the file says {filed} and {time[0]:.1f} s)"
            )
            axes.append((sum(abs(np.log(max(now, LEAST) / then)) for then, now in (speed, time)), sentence))
    idle = []
    drift = after.steady[0, 2]
    if abs(drift - before.steady[0, 2]) > NOTICED_DRIFT:
        idle.append(f"idle it {'rises' if drift < 0 else 'sinks'} at {abs(drift):.2f} m/s")
    turning = []
    for row, name in enumerate(CONTROLLED[:-1], start=1):
        rate = after.steady[row, 5]
        if abs(rate - before.steady[row, 5]) > NOTICED_TURN:
            turning.append(f"a {name} command of {command:g} also turns it at {quantity(rate, 'rad/s', 2, sign=True)}")
    most_first = sorted(axes, key=lambda axis: -axis[0])
    return {"axes": tuple(sentence for _, sentence in most_first), "idle": tuple(idle), "turning": tuple(turning)}
