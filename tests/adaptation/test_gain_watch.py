"""The test for a change of a single thruster."""

import numpy as np
import pytest

from auv_torchrl.adaptation import load_adaptation_config
from auv_torchrl.adaptation.detector import GainWatch
from auv_torchrl.adaptation.filter import Innovation
from auv_torchrl.adaptation.motion import Step

COUNT, THRUSTERS, D = 400, 3, 4
ENTRIES = np.arange(D, 2 * D)  # velocities


def run(change: float, steps: int, busy: float, seed: int = 0) -> np.ndarray:
    """Step (COUNT,) of the first alarm about a thruster 2 whose gain changes, ``steps`` if there is none."""
    rng = np.random.default_rng(seed)
    watch = GainWatch(COUNT, 4, THRUSTERS, 1000.0, load_adaptation_config())
    effect = rng.normal(size=(D, THRUSTERS))
    by_wrench = np.concatenate((np.zeros((D, D)), np.eye(D)))
    still = np.zeros((COUNT, D))
    step = Step(still, still, np.zeros((COUNT, 2 * D, D)), np.broadcast_to(by_wrench, (COUNT, 2 * D, D)))
    effectiveness = np.broadcast_to(effect, (COUNT, D, THRUSTERS))
    spread = np.broadcast_to(np.eye(D), (COUNT, D, D))
    first = np.full(COUNT, steps)
    for k in range(steps):
        share = rng.normal(size=(COUNT, THRUSTERS)) * (rng.random((COUNT, 1)) < busy)
        watch.predict(step, effectiveness, share)
        offset = rng.normal(size=(COUNT, D)) + change * share[:, 1:2] * effect[:, 1]
        zero = np.zeros((COUNT, 2 * D, D))
        watch.update(ENTRIES, Innovation(np.zeros(COUNT), offset, spread, zero), np.ones(COUNT, bool))
        alarmed = watch.statistic > 1
        first = np.where(alarmed, np.minimum(first, k), first)
    return first


def test_healthy_vehicles_raise_no_more_alarms_than_stated():
    """With one alarm in 1000 steps allowed, no more than that come, whatever is commanded."""
    for busy in (1.0, 0.1):
        alarms = (run(0.0, 1000, busy) < 1000).mean()
        assert alarms < 0.64  # 1 - exp(-1)


@pytest.mark.thorough
def test_a_thruster_that_hardly_works_is_found_out_too():
    """A dead thruster is noticed within a few steps in which it should have worked, however rare they are."""
    always, rarely = np.quantile(run(-1.0, 1500, 1.0), 0.9), np.quantile(run(-1.0, 1500, 0.1), 0.9)
    assert always < 60
    assert rarely < 15 * always


def test_one_wild_measurement_is_no_change():
    """A single innovation of any size leaves the sums below the threshold."""
    watch = GainWatch(1, 4, THRUSTERS, 1000.0, load_adaptation_config())
    watch.shift[:] = 1.0
    offset = np.full((1, D), 1e9)
    watch.update(ENTRIES, Innovation(np.zeros(1), offset, np.eye(D)[None], np.zeros((1, 2 * D, D))), np.ones(1, bool))
    assert 0 < watch.statistic[0] < 1
