"""Offline supervised training of F and R on transitions of the source vehicle."""

import logging
import time
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from auv_torchrl.ddr.models import Regressor, SourceModels
from auv_torchrl.physics import ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.physics.kinematics import quaternion_from_euler
from auv_torchrl.physics.pushes import wrench_per_share
from auv_torchrl.physics.thrusters import thrust_target
from auv_torchrl.tasks import Task, cruise_speed
from auv_torchrl.vehicle import Vehicle, index_of
from auv_torchrl.vehicle.tensors import tensors

SLIP = 0.3  # speed aside over the speed ahead: 17 degrees, beyond which a hull stalls
TURN = 0.35  # rad/m, turning over the speed ahead: a circle of 3 m radius

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PretrainingConfig:
    """Data and fit of F and R; the defaults leave R off by about 1 % of a full command after 3 CPU seconds."""

    transitions: int = 6000
    hidden: int = 48  # neurons per layer
    iterations: int = 400  # of L-BFGS
    overdrive: float = 1.6  # thrust beyond the source's own, so that R knows what a stronger thruster does
    tilt: float = 0.5  # rad, largest roll and pitch, where they are observed
    seed: int = 0


class Transitions(NamedTuple):
    """One control step each of n vehicles, float64."""

    state: Tensor  # (n, s) x
    realised: Tensor  # (n, a) channels
    next_state: Tensor  # (n, s) x'
    mixed: Tensor  # (n,) bool, commanded through the mixer; elsewhere the thrusters one by one


@torch.no_grad()
def source_transitions(vehicle: Vehicle, task: Task, models: SourceModels, config: PretrainingConfig) -> Transitions:
    """Excited one-step transitions of a source fleet.

    Speeds are drawn over two orders of magnitude up to the fastest the vehicle reaches, because both extremes
    matter: regulation happens at rest, identification at speed.
    """
    generator = torch.Generator().manual_seed(config.seed)
    count = config.transitions

    def uniform(*shape: int) -> Tensor:
        return 2 * torch.rand(count, *shape, generator=generator, dtype=torch.float64) - 1

    sound = tensors(vehicle)
    overdrive = 1.0 if vehicle.servos else config.overdrive  # a fin would stall
    strong = sound.replace(gain=sound.gain * overdrive)
    c = prepare(strong.expand(count).clone())
    command = (uniform(len(task.axes)) @ sound.mixer[:, index_of(task.axes)].mT).clamp(-1, 1)
    mixed = torch.ones(count, dtype=torch.bool)
    if task.tilt:  # single thrusters tilt the vehicle, which R must not take for one of the channels
        mixed = torch.rand(count, generator=generator) < 0.5
        command = torch.where(mixed[:, None], command, uniform(vehicle.thrusters))
    actuation = models.actuation.double()
    realised = actuation.pushes(actuation.delivered(command)) @ actuation.channels_per_share.mT * overdrive
    fastest = fastest_speeds(strong, task)
    velocity = fastest * uniform(6) * 10 ** (uniform(1) - 1)
    if cruise_speed(task):
        velocity[:, 0] = cruise_speed(task) * (1 + 0.5 * uniform())
    levels = torch.zeros(count, dtype=torch.float64)
    tilt = config.tilt * uniform(2) if task.tilt else torch.zeros(count, 2, dtype=torch.float64)
    if not task.tilt:
        velocity[:, 3:5] = 0
    quaternion = quaternion_from_euler(tilt[:, 0], tilt[:, 1], levels)
    position = torch.zeros(count, 3, dtype=torch.float64)
    before = rest_state(position, quaternion, velocity, vehicle.thrusters)
    terms = ActiveTerms.of(c)
    if terms.servos:  # where a servo is after some steps with the same command
        before = before._replace(thrust=thrust_target(c, terms, command))
    after = control_step(c, terms, before, command, task.control_dt)
    x, following = (models.state_of(s.quaternion, s.velocity) for s in (before, after))
    models.float()
    return Transitions(x, realised, following, mixed)


def fastest_speeds(vehicle: Vehicle, task: Task) -> Tensor:
    """Largest speeds (6,) worth knowing, m/s and rad/s: terminal speed at full thrust, or that of the starts.

    What flies ahead slips and turns by its hull, faster than fins alone would push it aside.
    """
    c = prepare(vehicle)
    force = wrench_per_share(c, ActiveTerms.of(c), cruise_speed(task)).abs().sum(-1)
    linear, quadratic = c.linear_drag.diagonal(), c.quadratic_drag.clamp_min(1e-6)
    terminal = (-linear + (linear**2 + 4 * quadratic * force).sqrt()) / (2 * quadratic)
    start = torch.tensor((*(task.start_speed,) * 3, 0.5, 0.5, task.start_yaw_rate), dtype=torch.float64)
    aside = cruise_speed(task) * torch.tensor((0.0, SLIP, SLIP, 0.0, TURN, TURN), dtype=torch.float64)
    return torch.maximum(torch.maximum(terminal, start), aside)


def pretrain(vehicle: Vehicle, task: Task, config: PretrainingConfig | None = None) -> SourceModels:
    """Train F and R for one source vehicle.

    Args:
        vehicle: the nominal vehicle (empty batch).
        task: whose control step they predict, and whether the vehicle tilts.
        config: data and fit.
    """
    config = config or PretrainingConfig()
    began = time.process_time()
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(config.seed)
        models = SourceModels(vehicle, task, config.hidden)
    x, realised, following, mixed = source_transitions(vehicle, task, models, config)
    change = (following - x).float()
    x, realised = x.float(), realised.float()  # in double precision R is no better, after twice the time
    fit(models.F.change, torch.cat((x, realised), -1)[mixed], change[mixed], config.iterations)
    fit(models.R.control, torch.cat((x, change), -1), realised, config.iterations)
    error = (models.R.control(torch.cat((x, change), -1)) - realised).square().mean().sqrt().item()
    models.requires_grad_(False)
    log.info("F and R trained in %.1f CPU s; R is off by %.4f of a full command", time.process_time() - began, error)
    return models


def fit(regressor: Regressor, inputs: Tensor, outputs: Tensor, iterations: int) -> None:
    """Minimise the mean square error in standardised outputs by L-BFGS on the whole data."""
    regressor.standardise(inputs, outputs)
    x, y = regressor.standardised(inputs), (outputs - regressor.output_mean) / regressor.output_scale
    optimizer = torch.optim.LBFGS(
        regressor.parameters(), max_iter=iterations, history_size=30, line_search_fn="strong_wolfe",
        tolerance_grad=1e-9, tolerance_change=1e-12,
    )  # fmt: skip

    def closure() -> Tensor:
        optimizer.zero_grad()
        loss = torch.nn.functional.mse_loss(regressor.of_standardised(x), y)
        loss.backward()
        return loss

    optimizer.step(closure)
