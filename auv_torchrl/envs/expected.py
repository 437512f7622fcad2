"""What a policy may know of a vehicle: what is measured now, or what a map that predicts expects of it."""

from typing import Any

import torch
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded

from auv_torchrl.envs.start import ALONG, BODY

TIME = "time"
MEASURED = "measured"  # the fleet's report of position, quaternion and velocity
EXPECTED = "expected"  # by a map that predicts: the same when the next command acts, and ``time`` then


def expected_along(tensordict: TensorDictBase) -> Tensor:
    """How far along the task (N, 1) vehicles will be when the next command acts, s."""
    return tensordict.get(ALONG) + (tensordict.get((EXPECTED, TIME)) - tensordict.get(TIME))


def expected_spec(observation_spec: Composite) -> Composite:
    """Spec of what a map that predicts reports under ``expected``."""
    lengths = {**BODY, TIME: 1}
    like: Any = observation_spec[MEASURED, "position"]
    shape = like.shape[:-1]
    entries = {
        key: Unbounded(torch.Size((*shape, length)), dtype=like.dtype, device=like.device)
        for key, length in lengths.items()
    }
    return Composite(entries, shape=shape, device=like.device)
