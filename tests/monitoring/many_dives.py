"""Dives without a log: the information that each has about five parameters, drawn from their true deviations."""

import numpy as np

from auv_torchrl.monitoring.changes import find_changes
from auv_torchrl.monitoring.dive_history import make_history
from auv_torchrl.monitoring.dive_record import Baseline, Dive, TrackedParameter
from auv_torchrl.vehicle import load_vehicle

REFERENCE = 3
PARAMETERS = (
    TrackedParameter("thruster_gain", "gain_3", 1.0, "1", 0.4),
    TrackedParameter("thruster_gain", "gain_5", 1.0, "1", 0.4),
    TrackedParameter("thruster_gain", "gain_6", 1.0, "1", 0.4),
    TrackedParameter("buoyancy", "force", 0.0, "N", 2.5),
    TrackedParameter("current", "north", 0.0, "m/s", 0.4, is_daily=True),
)
SPREAD = np.array([0.005, 0.005, 0.005, 0.5, 0.02])  # of a healthy vehicle, from dive to dive
PRECISE = np.array([0.004, 0.004, 0.2, 0.01])  # what one dive tells of each; 5 and 6 only in common
BASELINE = Baseline(PARAMETERS, np.diag(SPREAD**2), {"x": 0.002, "yaw": 0.004})


def dives_of(changed, seed=0, names=None, noise=None):
    """Dives whose parameters deviate by ``changed`` (n, 5) and by what healthy vehicles vary by."""
    rng, dives = np.random.default_rng(seed), []
    seen = np.array([[1.0, 0, 0, 0, 0], [0, 1, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]])
    A = seen.T @ np.diag(PRECISE**-2.0) @ seen
    for t, deviation in enumerate(np.asarray(changed, dtype=float)):
        own = deviation + SPREAD * rng.standard_normal(5)
        measured = seen @ own + PRECISE * rng.standard_normal(4)
        sizes = {c: s * np.exp(0.03 * rng.standard_normal()) for c, s in BASELINE.noise.items()}
        sizes = {c: size * (noise[t] if noise is not None and c == "x" else 1.0) for c, size in sizes.items()}
        name = names[t] if names else f"dive_{t + 1}.csv"
        dives.append(Dive(name, A, seen.T @ (measured / PRECISE**2), sizes, 1.0, 90.0))
    return dives


def fading(dives=20, per_dive=0.01):
    """Deviations of dives of which thruster 3 fades behind the reference."""
    changed = np.zeros((REFERENCE + dives, 5))
    changed[REFERENCE:, 0] = -per_dive * np.arange(1, dives + 1)
    return changed


def history_of(dives, rate=1000.0, diagnoses=None):
    """The report over these dives."""
    record = find_changes(dives, BASELINE, REFERENCE, rate)
    return make_history(dives, BASELINE, record, load_vehicle("paper"), "paper", rate, 1.15, diagnoses or {})
