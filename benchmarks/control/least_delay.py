"""How soon any test could notice a fault: what the measurements say about it, whoever reads them."""

import math

import numpy as np
import torch
from torch import Tensor

from auv_torchrl.adaptation import AdaptationConfig
from auv_torchrl.adaptation.filter import EffectivenessFilter
from auv_torchrl.adaptation.motion import SourceMotion
from auv_torchrl.adaptation.recovery import altered_thrust
from auv_torchrl.flight import Flight
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import CONTROLLED, CONTROLLED_INDEX, Vehicle
from auv_torchrl.vehicle.tensors import tensors

_D = len(CONTROLLED)


def least_delays(flight: Flight, begins_s: Tensor, vehicle: Vehicle, config: AdaptationConfig) -> Tensor:
    """Shortest mean detection delay (N,) in s that a test with the adapter's false alarms could have.

    No test with a mean of n steps between false alarms notices a change before its log likelihood ratio has grown by
    log n on average (Lorden 1971). The test that is told the fault and its moment gathers half the squared shift of
    the Kalman filter's innovations, in their standard deviations, per step; sensor noise, disturbance and drift are
    those that the adapter allows for.

    Args:
        flight: N flights with the fault.
        begins_s: (N,) when it was first felt; infinite if never.
        vehicle: one vehicle (empty batch) before the fault.
        config: of the adapter.
    """
    task = StationKeeping()
    motion = SourceMotion(vehicle, task.control_dt)
    kalman = EffectivenessFilter(motion, config)
    altered = altered_thrust(flight, vehicle)
    full = tensors(vehicle).full_thrust
    healthy = ((flight.thrust.double() - altered) / full).numpy()
    missing = (altered / full).numpy() @ motion.per_share.T  # (N, T + 1, 4) wrench
    velocity = flight.velocity.double().numpy()[..., list(CONTROLLED_INDEX)]
    count = len(velocity)
    everyone = np.ones(count, dtype=bool)
    belief = kalman.start(count)
    kalman.place(belief, np.arange(count), velocity[:, 0], config.velocity_noise)
    by_velocity = config.sensed == "velocity"
    entries = np.arange(_D, 2 * _D) if by_velocity else np.arange(_D)
    pose = (*(config.position_noise,) * 3, config.heading_noise)
    variance = np.square(np.full(_D, config.velocity_noise) if by_velocity else pose) * np.ones((count, 1))
    shift, gathered = np.zeros((count, 2 * _D)), np.zeros(count)
    time = flight.time.double().numpy()
    least = np.full(count, math.inf)
    needed = math.log(3600 / config.false_alarms_per_hour / task.control_dt)
    for k in range(1, time.shape[1]):
        begun = time[:, k] >= begins_s.numpy()
        belief.mean[:, kalman.velocity] = velocity[:, k - 1]
        step, _ = kalman.predict(belief, healthy[:, k], np.ones(count))
        moved = shift[:, :_D] + (step.by_velocity[:, :_D] @ shift[:, _D:, None])[..., 0]
        faster = (step.by_velocity[:, _D:] @ shift[:, _D:, None])[..., 0]
        shift = np.concatenate((moved, faster), axis=1)
        shift += (step.by_wrench @ (missing[:, k] * begun[:, None])[..., None])[..., 0]
        innovation = kalman.update(belief, entries, belief.mean[:, entries].copy(), variance, everyone)
        seen = shift[:, entries, None]
        gathered += 0.5 * (seen * np.linalg.solve(innovation.spread, seen)).sum((1, 2))
        shift -= (innovation.gain[:, kalman.moving] @ seen)[..., 0]
        least = np.where(gathered >= needed, np.minimum(least, time[:, k] - begins_s.numpy()), least)
    return torch.from_numpy(least).clamp_min(0.0)
