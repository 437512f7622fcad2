"""A vehicle that was calibrated is trained over what its file says is uncertain in it."""

import logging
import sys

import numpy as np
import pytest
import torch
import yaml

from auv_torchrl.envs.randomize import RandomizeVehicle
from auv_torchrl.experiment import command, job
from auv_torchrl.experiment.schema import randomization_of
from auv_torchrl.experiment.setup import spelt_out
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.experiment.conftest import TINY

PAPER = yaml.safe_load(config_path("vehicle", "paper").read_text())
ALIKE = 0.99  # correlation of the first two gains


def calibrated():
    """The vehicle ``paper`` as if it had been calibrated: two gains are unsure by the same scale, a drag by its own."""
    together = [[1.0], [ALIKE, (1 - ALIKE**2) ** 0.5], [0.0, 0.0, 1.0]]
    noise = {"x": 0.002}
    section = {
        "logs": ["a.csv"], "seconds": 60.0, "vehicle": "paper", "made": "today", "version": "0", "excess": 1.0,
        "level": True, "floor": [0.1] * 6, "noise": noise, "rough_noise": noise, "together": together,
    }  # fmt: skip
    uncertainty = {"thruster_gain": {"gain_1": 0.1, "gain_2": 0.1}, "linear_drag": {"scale_surge": 0.05}}
    return {**PAPER, "name": "mine", "uncertainty": uncertainty, "calibration": section}


@pytest.fixture
def mine(tmp_path):
    """Its file."""
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(calibrated()))
    return path


def drawn(ranges, count=4000):
    content = calibrated()
    vehicle = load_vehicle(content)
    spelt = spelt_out(ranges, content, vehicle)
    return spelt, RandomizeVehicle(vehicle, spelt).draw(count, torch.Generator().manual_seed(0))


def test_numbers_are_drawn_as_wide_and_as_alike_as_the_file_says():
    """Two standard deviations to each side, uniform, and gains that share a scale keep it."""
    spelt, fleet = drawn({"uncertainty": 2.0})
    assert spelt["thruster_gain"] == {"gain_1": [0.8, 1.2], "gain_2": [0.8, 1.2]}
    gain = fleet.gain.numpy()
    assert np.corrcoef(gain[:, 0], gain[:, 1])[0, 1] == pytest.approx(ALIKE, abs=0.002)
    np.testing.assert_allclose(gain[:, :2].std(0), 0.4 / 12**0.5, rtol=0.03)
    drag = fleet.linear_drag[:, 0, 0].numpy() / PAPER["linear_drag"][0]
    assert abs(np.corrcoef(gain[:, 0], drag)[0, 1]) < 0.05
    assert drag.min() > 0.9 - 1e-9 and drag.max() < 1.1 + 1e-9 and drag.std() > 0.05
    assert (gain[:, 2:] == 1).all()


def test_an_effect_that_is_given_replaces_what_the_file_says_of_it():
    """And the others stay as alike as they were; further effects stand beside them."""
    spelt, fleet = drawn({"uncertainty": 2.0, "thruster_gain": {"gain": [0.5, 0.6]}, "current": {"north": [0.0, 0.1]}})
    assert list(spelt) == ["linear_drag", "thruster_gain", "current", "together"]
    assert fleet.gain.min() >= 0.5 and fleet.gain.max() <= 0.6
    assert fleet.current[:, 0].max() > 0.09


@pytest.mark.parametrize("wide", [0, -1.0, "two", True, float("inf")])
def test_a_width_that_is_none_is_refused(wide):
    """With what to give."""
    with pytest.raises(ValueError, match="give a number of standard deviations above 0"):
        drawn({"uncertainty": wide})


def test_a_vehicle_that_is_sure_of_itself_has_nothing_to_train_over():
    """Said by name where it is asked for."""
    with pytest.raises(ValueError, match="vehicle=paper says nothing is uncertain"):
        spelt_out({"uncertainty": 2.0}, PAPER, load_vehicle("paper"))
    wide = read_vehicle_file("bluerov2")
    assert "together" not in spelt_out({"uncertainty": 1.0}, wide, load_vehicle("bluerov2"))


def test_shipped_vehicles_are_trained_over_what_they_were():
    """Their own file of ranges or the default, whatever their files say is uncertain."""
    for name in config_names("vehicle"):
        wanted = name if name in config_names("randomization") else "default"
        assert randomization_of(name) == wanted
    assert randomization_of("nowhere.yaml") == "default"


@pytest.mark.parametrize("asked", [[], ["randomization=default"], ["randomization.uncertainty=1.0"]])
def test_a_calibrated_vehicle_is_trained_over_its_own_uncertainty(mine, tmp_path, monkeypatch, caplog, asked):
    """Unless something else is asked for; which is said in one line."""
    experiments = []
    monkeypatch.setattr(job, "run", lambda experiment, folder: experiments.append(experiment))
    caplog.set_level(logging.INFO)
    quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none", f"output={tmp_path / 'out'}"]
    monkeypatch.setattr(sys, "argv", ["train.py", f"vehicle={mine}", *asked, *quiet])
    command.main()
    (experiment,) = experiments
    said = [record.getMessage() for record in caplog.records if "uncertain in it" in record.getMessage()]
    if "randomization=default" in asked:
        assert "together" not in experiment.randomization and not said
    else:
        wide = 1.0 if asked else 2.0
        assert experiment.randomization["thruster_gain"]["gain_1"] == [1 - 0.1 * wide, 1 + 0.1 * wide]
        assert len(said) == 1


def test_a_small_training_runs_over_it(mine, tmp_path, monkeypatch):
    """From the file to results.json."""
    quiet = ["hydra/job_logging=none", "hydra/hydra_logging=none"]
    out = tmp_path / "out"
    monkeypatch.setattr(
        sys, "argv", ["train.py", f"vehicle={mine}", *TINY, f"policies={tmp_path}", f"output={out}", *quiet]
    )
    command.main()
    assert (out / "results.json").is_file()
    assert "uncertainty: 2.0" in (out / "config.yaml").read_text()
