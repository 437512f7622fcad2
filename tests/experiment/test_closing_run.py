"""A run that closes the gap of a diagnosis: what it leaves behind and what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect, to_json
from auv_torchrl.experiment import closing
from auv_torchrl.experiment import run as running
from auv_torchrl.experiment.console import Stages
from tests.diagnosis.example import example


@pytest.fixture
def capable(monkeypatch, pd_policy):
    """A policy that can fly instead of the tiny one."""
    metadata = {"hash": "pd", "result": {"train_s": 1.0}, "curve": []}
    monkeypatch.setattr(running, "source_policy", lambda experiment: SourcePolicy(pd_policy, metadata))


@pytest.fixture
def swap():
    """A diagnosis that found the commands of thrusters 1 and 2 exchanged."""
    found = {f"command_{i}": Estimate(float(j), float(j), float(j), float(i), "1") for i, j in ((1, 2), (2, 1))}
    effect = FoundEffect("thruster_swap", 0.99, found, (1, 2), 1.0, "Thrusters 1 and 2 are exchanged.")
    return replace(example(), effects=(effect,), summary="Thrusters 1 and 2 are exchanged.")


@pytest.mark.thorough
@pytest.mark.usefixtures("capable")
def test_a_diagnosis_goes_into_the_controller_and_the_report_has_both_gaps(experiment, swap, tmp_path):
    """The swap is undone: nearly all of the controller's gap is closed, beside the share of the prediction's."""
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(to_json(swap)))
    ready = experiment("swap", f"diagnosis_file={path}", "flight.fly=false", "backend=mujoco")
    outcome = running.perform(ready, Stages(9))
    closed = outcome.results.as_dict()["closing"]
    assert closed["controller_gap_closed"] > 0.9 and not closed["tuned"]
    assert closed["prediction_gap_closed"] == pytest.approx(swap.gap.closed)
    assert "Thrusters 1 and 2 are exchanged." in outcome.results.table()
    assert "| diagnosed and closed |" in outcome.results.table()


@pytest.mark.usefixtures("capable")
def test_one_command_logs_diagnoses_and_closes(experiment, swap, tmp_path, monkeypatch):
    """The log that was diagnosed and the diagnosis lie in the folder of the run."""
    seen = []
    monkeypatch.setattr(closing, "diagnose", lambda log, vehicle, progress, vehicle_name: (seen.append(log), swap)[1])
    ready = experiment(
        "swap", "diagnose=true", "backend=mujoco", "flight.fly=false", "excitation.episodes=2", "excitation.episode_s=5"
    )
    outcome = running.perform(ready, Stages(10))
    assert outcome.closing is not None
    outcome.closing.save(tmp_path, ready)
    assert [len(episode) for episode in seen[0].episodes] == [100, 100]
    assert (tmp_path / closing.LOG).stat().st_size > 1000
    assert json.loads((tmp_path / closing.FILES / "diagnosis.json").read_text())["summary"] == swap.summary
    assert outcome.results.as_dict()["closing"]["log_s"] == pytest.approx(9.9)


def test_contradictory_or_empty_requests_are_refused(experiment, swap, tmp_path):
    """Two sources of a diagnosis, none of a target, nothing found, no flight to speak of."""
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(to_json(swap)))
    with pytest.raises(ValueError, match="give one of them"):
        experiment("swap", f"diagnosis_file={path}", "diagnose=true")
    with pytest.raises(ValueError, match=r"give \+scenario"):
        experiment("nominal", "diagnose=true")
    with pytest.raises(ValueError, match="5 s or more"):
        experiment("swap", "diagnose=true", "excitation.episode_s=1")
    path.write_text(json.dumps(to_json(replace(swap, effects=()))))
    with pytest.raises(ValueError, match="found no effect"):
        experiment("swap", f"diagnosis_file={path}")


def test_without_a_scenario_the_vehicle_of_the_diagnosis_is_flown(experiment, swap, tmp_path):
    """A real target cannot be flown here: its diagnosed simulator stands for it."""
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(to_json(swap)))
    ready = experiment("nominal", f"diagnosis_file={path}")
    assert ready.scenario.name == "diagnosed" and ready.diagnosed is not None
    assert np.array_equal(ready.target.routing, ready.diagnosed.vehicle.routing)
