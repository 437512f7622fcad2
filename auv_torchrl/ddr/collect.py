"""Collect target data with one vehicle and fit the map: the adaptation of Lu et al. 2023, section 4."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import TransformedEnv

from auv_torchrl.ddr.adapter import DDRAdapter
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.ddr.models import SourceModels
from auv_torchrl.envs import FleetEnv
from auv_torchrl.quantities import counted

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Adaptation:
    """A fitted adapter and how it came about; of several maps the whole, and the worst condition and error."""

    adapter: DDRAdapter
    target_data_s: float  # flown on the target, by the one vehicle or by each
    fit_s: float  # wall time of the final fit
    pairs: int  # informative ones, in the bags
    residual: float  # root mean square of Eq. 8 over the bag, channels
    condition: float  # of G
    standard_error: float  # of the weights of G, largest

    def __str__(self) -> str:
        return (
            f"map={self.adapter.config.map} from {self.target_data_s:.1f} s of target data ("
            f"{counted(self.pairs, 'informative pair')}), fitted in {1e3 * self.fit_s:.1f} ms: residual "
            f"{self.residual:.4f} of a full command, weights "
            f"within {self.standard_error:.4f}, condition {self.condition:.1f}"
        )


def adapt(
    make_target: Callable[[int], FleetEnv],
    policy: TensorDictModuleBase,
    models: SourceModels,
    config: AdapterConfig | None = None,
    count: int = 1,
) -> Adaptation:
    """Fly the target with the source policy plus dither, learn G, and return the adapter with H ready to use.

    Args:
        make_target: makes a fleet of that many target vehicles.
        policy: the source policy u_s, observation to action.
        models: F and R of the source vehicle.
        config: settings.
        count: number of target vehicles, each of which learns its own map; one is flown where the map is shared.

    Returns:
        The adapter, not learning any more, with no environment attached.
    """
    adapter = DDRAdapter(models, config, count)
    adapter.learning = True
    target = make_target(adapter.count)
    env = TransformedEnv(target, adapter)
    steps = round(adapter.config.target_data_s / target.task.control_dt)
    with torch.no_grad():
        env.rollout(steps, policy, break_when_any_done=False)
    env.close()
    adapter.reset_parent()
    adapter.learning = False
    began = time.perf_counter()
    adapter.learner.refit()
    fit_s = time.perf_counter() - began
    bags = [(learner.g, learner.bag.pairs()) for learner in adapter.learner.learners]
    error = torch.cat([g(pairs.state, pairs.control) - pairs.source for g, pairs in bags])
    adaptation = Adaptation(
        adapter=adapter,
        target_data_s=steps * target.task.control_dt,
        fit_s=fit_s,
        pairs=len(error),
        residual=float(error.square().mean().sqrt()),
        condition=max(float(g.condition) for g in adapter.maps),
        standard_error=max(float(g.standard_error) for g in adapter.maps),
    )
    log.info("%s", adaptation)
    return adaptation
