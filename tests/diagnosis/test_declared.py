"""What the diagnosis must know of an effect, the effect declares; settings may say otherwise."""

from dataclasses import asdict, replace

import pytest
import yaml

from auv_torchrl.diagnosis.command.request import read_settings
from auv_torchrl.diagnosis.identify.hypotheses import load_settings, make_candidates, nuisance_parameters
from auv_torchrl.effects import EFFECTS, Effect
from auv_torchrl.effects.trial import Trial
from auv_torchrl.paths import CONF, OWN
from auv_torchrl.vehicle import load_vehicle
from tests.own_python import FOULING

PAPER = load_vehicle("paper")
DECLARED = """
    trial=Trial(scans={"factor": Scan((1.4, 2.0, 2.8))}, nuisance={"factor": 0.05}, is_rough=True),
)

EFFECTS"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A folder of one's own with an effect that declares what the diagnosis does with it."""
    file = tmp_path / "effects" / "growth.py"
    file.parent.mkdir()
    own = FOULING.replace(")\n\nEFFECTS", DECLARED[1:])
    file.write_text("from auv_torchrl.effects.trial import Scan, Trial\n" + own)
    monkeypatch.setenv(OWN, str(tmp_path))


def test_an_effect_from_outside_needs_no_entry_in_the_settings(lab):
    """Its values are tried, its slack is a coefficient of a sound vehicle, and its roughness is known."""
    settings = load_settings()
    assert "fouling" not in (CONF / "diagnosis" / "default.yaml").read_text()
    tried = [candidate.values for candidate in make_candidates(PAPER, settings) if candidate.effect == "fouling"]
    assert tried == [{"factor": 1.4}, {"factor": 2.0}, {"factor": 2.8}]
    assert ("fouling", "factor", 1.0, 0.05) in nuisance_parameters(PAPER, settings)
    assert settings.is_rough("fouling")


def test_settings_stand_in_place_of_what_an_effect_declares(lab):
    """Other values, no slack, slopes, and not looked for at all."""
    settings = replace(
        load_settings(), scan={"fouling": {"factor": {"values": [3.0]}}}, nuisance={"fouling": {}}, thresholds=()
    )
    assert [candidate.values for candidate in make_candidates(PAPER, settings) if candidate.effect == "fouling"] == [
        {"factor": 3.0}
    ]
    assert "fouling" not in {effect for effect, *_ in nuisance_parameters(PAPER, settings)}
    assert not settings.is_rough("fouling")
    unsought = replace(settings, ignored=("fouling",))
    assert "fouling" not in {candidate.effect for candidate in make_candidates(PAPER, unsought)}


def test_the_shipped_settings_name_no_effect():
    """What they could say of one, the effects say themselves."""
    content = yaml.safe_load((CONF / "diagnosis" / "default.yaml").read_text())
    assert not content["scan"] and not content["nuisance"]
    assert content["ignored"] is None and content["thresholds"] is None


@pytest.mark.parametrize("name", EFFECTS)
def test_what_an_effect_declares_could_stand_in_the_settings(name):
    """Its values lie within the bounds, and its slack is a share."""
    effect = EFFECTS[name]
    content = yaml.safe_load((CONF / "diagnosis" / "default.yaml").read_text())
    scan = {parameter: asdict(scan) for parameter, scan in effect.trial.scans.items()}
    if effect.trial.together:
        scan = {"together": [dict(row) for row in effect.trial.together]}
    read_settings({**content, "scan": {name: scan}, "nuisance": {name: dict(effect.trial.nuisance)}}, PAPER)


@pytest.mark.parametrize("key", ["scans", "nuisance"])
def test_an_effect_declares_nothing_of_a_parameter_that_it_lacks(key):
    """The message names it and what there is."""
    known = EFFECTS["current"]
    assert isinstance(known, Effect)
    with pytest.raises(ValueError, match=f"{key} of nort: there are north, east, down .did you mean north"):
        replace(known, trial=replace(Trial(), **{key: {"nort": 0.1}}))
