"""Where a simulator differs from a log, by which of its parameters, and why this is believed.

1. A log is cut into windows; each has an unknown start and an unknown slow disturbance force (``windows``, ``path``).
2. With a wide prior on that force the windows are smoothed: measured motion, noise and outliers (``smooth``).
3. Along the measured motion every change of the model changes each step by a known amount; the response of the samples
   is the sensitivity of the change (``linear``).
4. Start and disturbance are integrated out of every window: one small quadratic in all parameters is left (``linear``).
5. What is uncertain about the model anyway is a Gaussian prior on nuisance parameters, in every hypothesis (``prior``).
6. Forward selection adds the change that the log evidence gains most from, fitted by full simulation (``fit``,
   ``select``).
7. Backward elimination takes away whatever the evidence does not pay for (``select``).
8. Posterior weights over all hypotheses give probabilities, the curvature gives intervals, near-equal hypotheses are
   indistinguishable, and what the winner leaves tells whether something unknown acts (``posterior``).

The engine knows no vehicle and no flight log: a :class:`Model` is any simulator (``model``). Read the modules in this
order: model, windows, path, linear, smooth, prior, fit, trace, search, select, posterior.
``bounded`` has the bounded minima that the diagnosis of vehicles uses.
"""

from auv_torchrl.sysid.fit import Fit
from auv_torchrl.sysid.model import Channel, Model, Parameter, StepModel
from auv_torchrl.sysid.path import Problem
from auv_torchrl.sysid.posterior import Interval, chance, indistinguishable, intervals, is_explained, probabilities
from auv_torchrl.sysid.prior import Candidate, Hypothesis, Prior
from auv_torchrl.sysid.select import Selection, identify, select
from auv_torchrl.sysid.smooth import Smoothing, smooth
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace
from auv_torchrl.sysid.windows import Disturbance, Noise, Windows, cut
from auv_torchrl.sysid.windows import Record as LogRecord

__all__ = [
    "Candidate",
    "Channel",
    "Disturbance",
    "Fit",
    "Hypothesis",
    "Interval",
    "LogRecord",
    "Model",
    "Noise",
    "Outcome",
    "Parameter",
    "Prior",
    "Problem",
    "Record",
    "SearchTrace",
    "Selection",
    "Smoothing",
    "StepModel",
    "Windows",
    "chance",
    "cut",
    "identify",
    "indistinguishable",
    "intervals",
    "is_explained",
    "probabilities",
    "select",
    "smooth",
]
