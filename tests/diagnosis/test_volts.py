"""Thrust against the volts of the battery that a log has."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.conclude.findings import volts_findings
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.validate.confirm import confirm
from auv_torchrl.diagnosis.validate.predict import errors_by_kind, predict
from auv_torchrl.effects.effect import changed
from auv_torchrl.physics import prepare
from auv_torchrl.physics.thrusters import VOLTS_EXPONENT, at_volts
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
RATED = changed(PAPER, volts=torch.tensor(16.0))
SAG = 0.5  # of the thrust per minute
FORCE = np.full(4, 0.5)  # N, N m


@pytest.fixture(scope="module")
def log():
    """A vehicle whose thrust fades as the volts that are logged do."""
    flown = fly(hold(PAPER), {"battery_sag": {"rate": SAG}}, episodes=4, seed=3)
    return replace(
        flown,
        episodes=tuple(replace(e, battery=16.0 * (1 - SAG * e.t / 60) ** (1 / VOLTS_EXPONENT)) for e in flown.episodes),
    )


def test_volts_explain_fading_before_the_battery_may(log):
    """Where the file says at which volts its thrusts hold, there is no gap; where it does not, thrust fades."""
    assert diagnose(log, RATED).verdict is Verdict.NO_GAP
    found = diagnose(log, PAPER)
    assert [effect.name for effect in found.effects] == ["battery_sag"]
    assert found.effects[0].parameters["rate"].value == pytest.approx(SAG, abs=0.05)


def test_mujoco_flies_with_the_logged_volts(log):
    """Where volts take thrust, MuJoCo flies as the plain model predicts; at full volts it flies elsewhere."""
    rated, full = hold(RATED), hold(PAPER)
    predictions = predict(
        log, [rated, full], load_settings(), {"x": 0.002, "y": 0.002, "z": 0.002, "yaw": 0.004}, FORCE
    )
    plain = errors_by_kind(predictions)["position_m"]
    found = confirm(predictions, [rated, full]).position_m
    assert plain is not None and found is not None
    assert found.before == pytest.approx(plain.before, abs=0.005)  # by the mean volts of each stretch
    assert found.after[-1] > 4 * found.before[-1]


def test_volts_are_told(log):
    """How far thrust follows; what the file lacks; volts that are no battery of these thrusters."""
    (told,), (asked,) = volts_findings(log, RATED), volts_findings(log, PAPER)
    assert told.code == "volts" and "16 V" in told.sentence
    assert asked.code == "volts_unused" and "under thrusters" in asked.remedy
    surface = replace(log, episodes=tuple(replace(e, battery=np.full(len(e), 48.0)) for e in log.episodes))
    assert volts_findings(surface, RATED)[0].code == "odd_volts"
    assert not volts_findings(replace(log, episodes=tuple(replace(e, battery=None) for e in log.episodes)), RATED)


def test_thrust_follows_volts_as_the_chart_of_a_t200():
    """3.71 of 5.25 kgf at 12 V; all of it where volts are not known, or cannot be."""
    c = prepare(RATED.expand(1)).numpy()
    given = np.array([16.0, 12.0, np.nan, 0.0, 48.0])
    assert at_volts(c, given) == pytest.approx([1.0, 3.71 / 5.25, 1.0, 1.0, 1.0], abs=0.01)
    assert (at_volts(prepare(PAPER.expand(1)).numpy(), given) == 1.0).all()
