"""White noise of the sensors: what a log shows of the effect that is declared to be noise.

Noise widens the floor of every prediction and closes no gap. So it is measured beside the explanation, from what is
left when a free force follows everything slower, and not weighed against it.
"""

import numpy as np

from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.flightlog.log import ANGLES

STATED = 1.3  # times the noise that the vehicle file states, from which the sensors are worse than that
LEAST_BELIEVED = 1e-5  # m, rad, m/s, rad/s, m/s^2: a hundredth of what the best sensors of this kind scatter by
OUTLYING = 3e-4  # share of the samples from which outliers are worth a word; noise makes one in a million
UNITS = {"x": "m", "y": "m", "z": "m", "roll": "rad", "pitch": "rad", "yaw": "rad", "u": "m/s", "v": "m/s", "w": "m/s",
         "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s^2", "ay": "m/s^2", "az": "m/s^2"}  # fmt: skip


def noise_finding(problem: Problem) -> Finding:
    """The noise of each channel, a warning where the vehicle states less, with the effect that reproduces it."""
    sizes = ", ".join(f"{name} {size:.2g} {UNITS[name]}" for name, size in problem.sigma.items())
    values = measured_noise(problem.sigma)
    stated = {"position": float(problem.vehicle.position_noise), "attitude": float(problem.vehicle.attitude_noise)}
    worse = [name for name, value in values.items() if 0 < STATED * stated[name] < value]
    simulate = ", ".join(f"{name}: {value:.2g}" for name, value in values.items())
    effect = next(effect.name for effect in EFFECTS.values() if effect.trial.is_noise)
    remedy = f"To simulate it, add the effect {effect}: {{{simulate}}}" if values else ""
    if not worse:
        sentence = f"white noise of the sensors, the floor of all predictions: {sizes}"
        return Finding(Severity.INFO, effect, sentence, remedy)
    sentence = f"the sensors are noisier than the vehicle states ({', '.join(worse)}): {sizes}"
    return Finding(Severity.WARNING, effect, sentence, remedy)


def quiet_findings(problem: Problem) -> tuple[Finding, ...]:
    """A doubt about channels with next to no noise: they are no measurement, or not only one."""
    quiet = tuple(name for name, size in problem.sigma.items() if size < LEAST_BELIEVED)
    if not quiet:
        return ()
    sentence = f"{', '.join(quiet)} have next to no noise: they were simulated, filtered or made up, not measured"
    return (Finding(Severity.WARNING, "no_noise", sentence, "Log what the sensors say", quiet, limits=True),)


def outlier_findings(problem: Problem) -> tuple[Finding, ...]:
    """A warning about samples that were given less weight because no force on the vehicle could have reached them."""
    if sum(problem.outlying.values()) < OUTLYING * problem.windows.numbers:
        return ()
    counts = ", ".join(f"{count} of {name}" for name, count in problem.outlying.items())
    sentence = f"some values lie off every path that forces could have made ({counts}); they count less"
    return (Finding(Severity.WARNING, "outliers", sentence, "Check the sensor", tuple(problem.outlying)),)


def measured_noise(sigma: dict[str, float]) -> dict[str, float]:
    """Parameters of the effect of noise from the noise of the channels of a pose."""
    groups = {"position": [sigma[a] for a in "xyz" if a in sigma], "attitude": [sigma[a] for a in ANGLES if a in sigma]}
    return {name: float(np.sqrt(np.mean(np.square(sizes)))) for name, sizes in groups.items() if sizes}
