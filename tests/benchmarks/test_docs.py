"""What the documents show works: the effect that one adds, the number of effects that the benchmark flies."""

import re
from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.verdict import Verdict
from auv_torchrl.effects import EFFECTS, Effect
from auv_torchrl.paths import OWN, PROJECT
from auv_torchrl.physics import prepare
from auv_torchrl.sensors import MOTION, read
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.changed_file import described
from benchmarks.blind.flights.outside import OUTSIDE
from tests.flightlog.simulate import simulated_logs

DOCS = PROJECT / "docs"


@pytest.fixture
def effect(tmp_path, monkeypatch) -> Effect:
    """The effect that the document adds, as a file of one's own."""
    document = (DOCS / "how-to" / "add-an-effect.md").read_text()
    code = next(block for block in re.findall(r"```python\n(.*?)```", document, re.S) if "Effect(" in block)
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "sound_speed.py").write_text(code)
    monkeypatch.setenv(OWN, str(tmp_path))
    return EFFECTS["sound_speed"]


def test_the_example_effect_is_an_effect(effect):
    """The entry of the document changes what acoustic sensors report, and at its nominal value nothing."""
    vehicle = load_vehicle("paper")
    assert described(effect.apply(vehicle, effect.nominal(vehicle))) == described(vehicle)
    c = prepare(effect.apply(vehicle, {"factor": np.array([1.0, 1.2])})).numpy()
    motion = np.tile([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, 1.0, 0.5, 0.2, 0.1, 0.2, 0.3], (2, 1))
    true, off = read(c, MOTION, motion)
    np.testing.assert_allclose(true, motion[0])
    np.testing.assert_allclose(off / true, [1.2, 1.2, 1, 1, 1, 1, 1.2, 1.2, 1.2, 1, 1, 1])


def test_the_example_effect_is_diagnosed(effect):
    """A log with a wrong speed of sound is explained by the effect of the document, at its value."""
    (log,) = simulated_logs("paper", [{effect.name: {"factor": 1.2}}], episodes=3, seconds=16.0, seed=1)
    tried = {effect.name, "thruster_gain", "current", "position_scale", "velocity_scale", "heading_bias"}
    settings = replace(load_settings(), ignored=tuple(name for name in EFFECTS if name not in tried))
    found = diagnose(log, load_vehicle("paper"), vehicle_name="paper", settings=settings)
    assert found.verdict is Verdict.EXPLAINED
    (named,) = found.effects
    assert named.name == effect.name
    factor = named.parameters["factor"]
    assert factor.low <= 1.2 <= factor.high and factor.high - factor.low < 0.1


def test_the_document_counts_what_is_flown():
    """The number of effects outside the library is the one that is flown."""
    text = (DOCS / "results" / "diagnosis.md").read_text()
    assert {11: "eleven"}[len(OUTSIDE)] in text
