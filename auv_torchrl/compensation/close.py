"""From a diagnosis to a controller: rehearse in the diagnosed simulator, and train on where the map leaves a gap."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from torchrl.envs import Compose, EnvBase, TransformedEnv
from torchrl.envs.transforms import Transform

from auv_torchrl.agents.config import AgentConfig, FineTuning
from auv_torchrl.agents.fine_tune import Ground, fine_tune
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.compensation.diagnosed import Diagnosed
from auv_torchrl.compensation.known_vehicle import KnownVehicle
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import RandomizeVehicle, make_fleet
from auv_torchrl.evaluation import Metrics, draw_starts, fly
from auv_torchrl.quantities import quantity
from auv_torchrl.tasks import Task
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger(__name__)

_REHEARSALS = 64  # vehicles of a rehearsal
_SEED = 271_828  # of their starts and parameters; reported flights use others


@dataclass(frozen=True)
class Closed:
    """A controller for the vehicle that was diagnosed, and how it flew in the simulator; mean misses in m."""

    diagnosed: Diagnosed
    policy: SourcePolicy
    task: Task  # of the evaluation
    nominal_m: float  # u_s on the nominal vehicle
    before_m: float  # u_s on the vehicles that the diagnosis leaves possible
    mapped_m: float  # u_s behind the map of the diagnosed vehicle, on the same
    tuned_m: float | None  # the policy trained on, behind the same map; None where nothing was left to train for

    @property
    def tuned(self) -> bool:
        """Whether the policy was trained on and is better for it."""
        return self.tuned_m is not None and self.tuned_m < self.mapped_m

    def adapter(self) -> Transform:
        """A fresh map of the diagnosed vehicle, and the observation of what it expects."""
        return _adapter(self.diagnosed, self.task)

    def fleet(self, fleet: EnvBase) -> EnvBase:
        """A fleet that takes thruster commands, behind the map."""
        return TransformedEnv(fleet, self.adapter())


def close(
    diagnosed: Diagnosed,
    policy: SourcePolicy,
    task: Task,
    box_m: float,
    agent: AgentConfig,
    tuning: FineTuning,
    seed: int,
    backend: str,
    folder: Path,
    device: str = "cpu",
) -> Closed:
    """Put what was diagnosed into the simulator and the controller.

    The map of the diagnosed vehicle (:class:`KnownVehicle`) undoes what commands can undo. If on vehicles drawn
    from the intervals it still flies worse than u_s does on the nominal vehicle, the policy is trained on behind
    it, on such vehicles; the better one is taken.

    Args:
        diagnosed: what was found.
        policy: the source policy u_s; training goes on on its device.
        task: of its training.
        box_m: half width of the starts of the rehearsal, m.
        agent: settings of its training.
        tuning: settings of the training on.
        seed: of the training.
        backend: "mujoco" or "torch".
        folder: the store of policies.
        device: of the rehearsals.
    """
    exam = task.for_evaluation(box_m)

    def rehearse(who: SourcePolicy, base: Vehicle, ranges: Mapping[str, Any], mapped: bool) -> Metrics:
        transforms = [RandomizeVehicle(base, ranges, seed=_SEED), *([_adapter(diagnosed, exam)] if mapped else [])]
        rehearsal = replace(exam, thruster_commands=mapped)
        fleet = make_fleet(backend, base, rehearsal, _REHEARSALS, seed=_SEED, device=device)
        starts = draw_starts(rehearsal, _REHEARSALS, _SEED)
        return Metrics.of(fly(TransformedEnv(fleet, Compose(*transforms)), who.module, starts, rehearsal.steps))

    possible = (diagnosed.switched, diagnosed.ranges)
    nominal = rehearse(policy, diagnosed.nominal, {}, mapped=False)
    before = rehearse(policy, *possible, mapped=False)
    mapped = rehearse(policy, *possible, mapped=True)
    log.info(
        "   in the diagnosed simulator: u_s %s, behind the map %s (nominal %s)",
        *(quantity(flown.miss_m, "m") for flown in (before, mapped, nominal)),
    )
    missed = nominal.miss_m, before.miss_m, mapped.miss_m
    if mapped.holds_as_well_as(nominal):
        return Closed(diagnosed, policy, exam, *missed, None)
    ground = Ground(
        vehicle=diagnosed.vehicle,
        base=diagnosed.switched,
        ranges=diagnosed.ranges,
        adapter=lambda: _adapter(diagnosed, exam),
        adapter_name="known vehicle",
    )
    training = replace(task, thruster_commands=True)
    better = fine_tune(policy, ground, training, agent, tuning, seed, backend, folder)
    tuned = rehearse(better, *possible, mapped=True).miss_m
    log.info("   trained on: %s", quantity(tuned, "m"))
    return Closed(diagnosed, better if tuned < mapped.miss_m else policy, exam, *missed, tuned)


def _adapter(diagnosed: Diagnosed, task: Task) -> Transform:
    return observing(KnownVehicle(diagnosed.nominal, diagnosed.vehicle, task), task)
