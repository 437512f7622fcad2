"""What an effect leaves in the samples: the mark that is worked out along the motion, against two simulations."""

from functools import cache

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import batch
from auv_torchrl.diagnosis.motion.actuation import actuate
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.force import MeasuredMotion, middles, reading_changes, responses
from auv_torchrl.diagnosis.motion.rollout import fly
from auv_torchrl.diagnosis.motion.smooth import Layout, local_slopes
from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import simulated_logs
from tests.hovering import ACTING

VEHICLE = load_vehicle("bluerov2")  # free to tilt
NOISE = {"roll": 4e-3, "pitch": 4e-3, "yaw": 4e-3, "ax": 0.05, "ay": 0.05, "az": 0.05}  # rad, m/s^2; else 2e-3
SHARES = (0.002, 0.02, 0.9)  # of the way from nominal to a bound
SHOWS = 0.05  # standard deviations of the sensors, root mean square
SILENT = {"depth_bias", "sensor_noise"}  # a constant offset is where the vehicle is; noise is no motion


@cache
def flown():
    """Windows of half a second of a log of everything, their slopes and states under the nominal vehicle."""
    (log,) = simulated_logs("bluerov2", [{}], episodes=2, seconds=12.0, seed=2, noise=(0.0, 0.0), felt=0.0)
    windows = cut_windows(log, 0.5, 1.5, 0.2)
    layout, one = Layout.of(windows, VEHICLE, 0.2), batch(VEHICLE, [{}])
    state = local_slopes(windows, one, layout, windows.guess, np.zeros((len(windows), layout.bins, len(layout.dof))))
    samples, states = fly(actuate(windows, one), windows.guess[:, None])
    return windows, layout, one, state, samples[:, 0], states[:, 0]


def simulated_and_marked(values):
    """How the samples change in simulation, and as the mark says, the starts fitted: (W, K) in units of the noise."""
    windows, layout, one, state, samples, states = flown()
    changed = batch(VEHICLE, [values])
    c, beyond = (prepare(its).numpy() for its in (one, changed))
    responded = responses(windows, c, layout, state, MeasuredMotion.of(windows, c, middles(states)).forces(beyond))
    read = reading_changes(windows, c, beyond, states)
    responded = (responded if read is None else responded + read)[..., 0]
    after = fly(actuate(windows, changed), windows.guess[:, None])[0][:, 0]
    simulated = windows.residual(samples) - windows.residual(after)
    weight = np.tile([1 / NOISE.get(name, 2e-3) for name in windows.channels], windows.measured.shape[1])
    slopes = state.slope[..., : len(layout.start)] * weight[:, None]

    def fitted(change):
        change = (change.reshape(len(windows), -1) * weight)[..., None]
        return (change - slopes @ np.linalg.pinv(slopes) @ change)[..., 0]

    return fitted(simulated), fitted(responded)


def moved(effect):
    """Values of an effect farther and farther from nominal, towards either bound."""
    nominal, declared = effect.nominal(VEHICLE), effect.member_parameters(VEHICLE)
    if any(p.discrete for p in declared.values()):
        yield dict(zip(list(nominal)[:2], list(nominal.values())[1::-1], strict=True))
        return
    for share in SHARES:
        for bound in ("high", "low"):
            ends = {name: getattr(p, bound) for name, p in declared.items()}
            if ends != nominal:
                yield {name: nominal[name] + share * (ends[name] - nominal[name]) for name in nominal}


@pytest.mark.parametrize("name", ACTING)
def test_two_simulations_differ_by_the_mark(name):
    """Every effect, of a sensor or of the vehicle, marks the samples as two simulations of a small change differ."""
    closest = np.inf
    for values in moved(EFFECTS[name]):
        simulated, responded = simulated_and_marked({name: values})
        if np.sqrt((simulated**2).mean()) > SHOWS:
            closest = min(closest, np.linalg.norm(responded - simulated) / np.linalg.norm(simulated))
            if closest < 0.4:
                return
        elif name in SILENT:
            assert np.sqrt((responded**2).mean()) < SHOWS
    assert name in SILENT or closest < 0.55, f"off by {closest:.0%}"  # a whole exchange of two thrusters is not small
