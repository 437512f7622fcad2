"""``python -m benchmarks.underway.turn``: what the rudder that is left allows a helm that has been told of the fault.

The upper rudder of the torpedo is stuck from the start of a flight. The helm limits the rate with which it turns; each
limit is flown from the starts of the control benchmark. What it reaches is no more than what the fins forbid.
"""

import itertools

import numpy as np

from auv_torchrl.evaluation import STEADY_FROM_S, draw_starts
from auv_torchrl.paths import config_path
from auv_torchrl.physics import rest_state
from auv_torchrl.physics.kinematics import euler_angles, wrap_angle
from auv_torchrl.scenario import read_scenario
from auv_torchrl.simulator import PlainSimulator
from auv_torchrl.tasks import Cruise
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.yaml_file import read_yaml

VEHICLE, FAULT = "remus100", "fin_stuck"
PROPELLER, LEFT, PORT, STARBOARD = 0, 2, 3, 4  # places of the actuators; the rudder that is left is the lower one
STARTS, SEED = 100, 2023  # as of the control benchmark
RATES = (0.04, 0.06, 0.08, 0.1, 0.14, 0.2, 0.3)  # rad/s, that the helm turns with at most
GAINS = (0.6, 1.2)  # 1/s, rate that is wanted for an error of heading
STIFF = 40.0  # s, rudder for an error of the rate: nearly all or nothing


def measure(starts: int = STARTS, rates: tuple[float, ...] = RATES) -> dict[tuple[float, float], np.ndarray]:
    """Mean absolute heading error from 10 s on in rad, (starts,), by limit of the rate and by gain."""
    vehicle = load_vehicle(VEHICLE)
    scenario = read_scenario(FAULT, read_yaml(config_path("scenario", FAULT), "scenario"), vehicle)
    task = Cruise().fitted(vehicle).for_evaluation(1.0)
    begin = draw_starts(task, starts, SEED).double()
    helms = list(itertools.product(rates, GAINS))
    limit, gain = np.repeat(np.array(helms), starts, axis=0).T
    body = [np.tile(np.asarray(begin[name]), (len(helms), 1)) for name in ("position", "quaternion", "velocity")]
    simulator = PlainSimulator(scenario.vehicle_at(vehicle).expand(len(limit)), task.control_dt)
    simulator.resume(rest_state(body[0], body[1], body[2], vehicle.thrusters))
    errors = []
    for step in range(task.steps):
        simulator.step(_commands(simulator, gain, limit, vehicle.thrusters))
        if (step + 1) * task.control_dt >= STEADY_FROM_S:
            errors.append(np.abs(wrap_angle(euler_angles(simulator.state.quaternion)[2])))
    means = np.mean(errors, axis=0).reshape(len(helms), starts)
    return dict(zip(helms, means, strict=True))


def _commands(simulator: PlainSimulator, gain: np.ndarray, limit: np.ndarray, actuators: int) -> np.ndarray:
    """Speed, depth and level roll as a helmsman holds them, and the rate that the heading asks for."""
    state = simulator.state
    roll, pitch, yaw = euler_angles(state.quaternion)
    rate = np.clip(-gain * wrap_angle(yaw), -limit, limit)
    stern = 0.34 + 5.0 * (np.clip(0.4 * state.position[:, 2], -0.3, 0.3) - pitch) - 2.0 * state.velocity[:, 4]
    level = np.clip(2.0 * roll + state.velocity[:, 3], -0.5, 0.5)
    command = np.zeros((len(yaw), actuators))
    command[:, PROPELLER] = 0.75 + 0.5 * (1.5 - state.velocity[:, 0])
    command[:, LEFT] = STIFF * (state.velocity[:, 5] - rate)  # a rudder to starboard turns to port
    command[:, PORT], command[:, STARBOARD] = stern + level, stern - level
    return np.clip(command, -1.0, 1.0)


def main() -> None:
    """Print, for each limit of the rate, the best gain."""
    found = measure()
    print("| turns with at most | heading, 10 s to 30 s | a tenth of the starts above |\n|---:|---:|---:|")
    for limit in RATES:
        best = min((found[limit, gain] for gain in GAINS), key=np.mean)
        mean, high = np.degrees((best.mean(), np.quantile(best, 0.9)))
        print(f"| {limit:g} rad/s | {mean:.1f}° | {high:.1f}° |")


if __name__ == "__main__":
    main()
