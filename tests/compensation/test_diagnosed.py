"""What was diagnosed becomes a vehicle, ranges to train over, and a controller."""

import json
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
import torch

from auv_torchrl.agents.config import FineTuning, load_agent_config
from auv_torchrl.agents.fine_tune import Ground, fine_tune
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.agents.train_source import train_source
from auv_torchrl.compensation.close import close
from auv_torchrl.compensation.diagnosed import Diagnosed, read_diagnosed
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.compensation.known_vehicle import KnownVehicle
from auv_torchrl.compensation.target_log import fly_target_log
from auv_torchrl.diagnosis.verdict import Estimate, FoundEffect, to_json
from auv_torchrl.envs import make_fleet
from auv_torchrl.envs.randomize import read_ranges
from auv_torchrl.flightlog import Severity, read_flightlog, write_flightlog
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.example import example
from tests.entries import with_entry

VEHICLE = load_vehicle("paper")
TASK = StationKeeping(episode_s=1.0)
TINY = load_agent_config(
    overrides={
        "hidden": [8, 8], "batch_size": 16, "num_envs": 4, "steps_per_batch": 5, "stretch_steps": 20,
        "total_frames": 160, "random_frames": 40, "buffer_size": 200, "evaluation_starts": 2,
    }
)  # fmt: skip


@pytest.fixture(scope="module")
def source(tmp_path_factory) -> SourcePolicy:
    """A policy that has learnt next to nothing."""
    return train_source(VEHICLE, TASK, TINY, {}, 0, "mujoco", tmp_path_factory.mktemp("policies"))


def test_a_diagnosis_is_read_as_vehicle_and_ranges(tmp_path):
    """Values and intervals of diagnosis.json are those of the vehicle and of the randomization."""
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(to_json(example())))
    found = read_diagnosed(path, VEHICLE, "paper")
    assert found.found
    for change in found.scenario.changes:
        (told,) = [effect for effect in example().effects if effect.name == change.effect.name]
        assert change.values == pytest.approx({name: e.value for name, e in told.parameters.items()}, abs=1e-5)
        for name, (low, high) in found.ranges.get(change.effect.name, {}).items():
            assert low <= change.values[name] <= high
    read_ranges(VEHICLE, found.ranges)


def test_a_value_of_nearly_nothing_is_a_number_too():
    """What YAML 1.1 takes for a word, 5e-05, is the value that was found."""
    made = example()
    place = {axis: Estimate(value, value, value, 0.0, "m") for axis, value in (("x", 0.1), ("y", 5e-05))}
    shifted = FoundEffect("mass_offset", 0.99, place, (), 0.9, "The mass is off.")
    found = Diagnosed.of(replace(made, effects=(shifted,)), VEHICLE)
    assert found.scenario.changes[0].values["y"] == 5e-05


def test_what_is_no_diagnosis_of_this_vehicle_is_refused_with_the_remedy(tmp_path):
    """Missing, damaged, of another vehicle."""
    with pytest.raises(FileNotFoundError, match=r"diagnosis\.json that diagnose\.py wrote"):
        read_diagnosed(tmp_path / "no.json", VEHICLE, "paper")
    path = tmp_path / "diagnosis.json"
    for content in ("", "[]", "{}", '{"version": 1}', '{"version": 7}'):
        path.write_text(content)
        with pytest.raises(ValueError, match=r"no diagnosis|version"):
            read_diagnosed(path, VEHICLE, "paper")
    path.write_text(json.dumps(to_json(example())))
    with pytest.raises(ValueError, match="vehicle=paper"):
        read_diagnosed(path, load_vehicle("bluerov2"), "bluerov2")


GAIN = ("effects", 0, "parameters", "gain_4")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ((*GAIN, "value"), 40.0, r"gain_4 of thruster_gain is 40, not in \[-2, 2\]"),
        ((*GAIN, "value"), -0.9, "gain_4 of thruster_gain is -0.9, outside its interval"),
        ((*GAIN, "value"), float("nan"), "NaN is no number of JSON"),
        ((*GAIN, "value"), None, "gain_4.value is None instead of a number"),
        ((*GAIN, "value"), "0.5", "value is '0.5' instead of a number"),
        ((*GAIN, "value"), True, "value is True instead of a number"),
        ((*GAIN, "low"), float("inf"), "Infinity is no number of JSON"),
        ((*GAIN, "low"), ..., "'low' is missing"),
        ((*GAIN, "unit"), ..., "unit"),
        (
            ("effects", 0, "parameters", "gain_9"),
            {"value": 1, "low": 1, "high": 1, "nominal": 1, "unit": "1"},
            "gain_9",
        ),
        (("effects", 0, "name"), "fouling", "no effect named 'fouling': there are"),
        (("effects", 0, "name"), ["thruster_gain"], "name is .* instead of a text"),
        (("effects", 0, "probability"), 7.0, "probability of thruster_gain is 7"),
        (("effects", 0, "thrusters"), [12], "names thruster 12, the vehicle has 6"),
        (("effects", 0, "thrusters"), ["one"], "instead of a whole number"),
        (("effects", 0, "advice"), [{"do": 3}], "do is 3 instead of a text"),
        (("effects", 0, "advice"), [{"do": "turn it", "param": {"MOT_1_DIRECTION": "left"}}], "instead of a number"),
        (("effects", 0, "colour"), "red", "colour"),
        (("effects",), {"thruster_gain": 0.5}, "is no diagnosis"),
        (("effects",), ..., "'effects' is missing"),
        (("verdict",), "fine", "'FINE' is missing or unknown"),
        (("vehicle",), "submarine", "about vehicle 'submarine'.*give vehicle=submarine"),
        (("vehicle",), 3, "vehicle is 3 instead of a text"),
        (("where", "onset_s"), "late", "onset_s is 'late' instead of a number"),
        (("gap", "horizon_s"), ["soon"], "horizon_s.* instead of a number"),
        (("gap",), None, "is no diagnosis"),
    ],
    ids=str,
)
def test_a_diagnosis_that_was_changed_is_refused_by_the_entry(tmp_path, path, value, message):
    """What a value cannot be is neither bent to fit nor flown: one line names it."""
    content = with_entry(json.loads(json.dumps(to_json(example()))), path, value)
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=message) as error:
        read_diagnosed(file, VEHICLE, "paper")
    assert str(file) in str(error.value) and "\n" not in str(error.value)
    assert "give" in str(error.value) and type(error.value) is ValueError


@pytest.mark.parametrize(
    "content", [b"{", b"\xff\xfe{", b"[" * 100_000, b'{"version": 1, "version": 1}', b" " * 10_000_001], ids=range(5)
)
def test_a_broken_diagnosis_is_refused_in_one_line(tmp_path, content):
    """Cut off, in another encoding, endless, with a key twice."""
    file = tmp_path / "diagnosis.json"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=r"diagnosis.json is no diagnosis \(.*\): give the diagnosis.json that"):
        read_diagnosed(file, VEHICLE, "paper")


def test_swaps_stay_fixed_while_everything_else_is_drawn():
    """The base of the randomization has the effects without range, and no other."""
    content = {"effects": {"thruster_swap": {"pair": [1, 2]}, "buoyancy": {"force": 5.0}}}
    found = Diagnosed(VEHICLE, read_scenario("told", content, VEHICLE), {"buoyancy": {"force": [4.0, 6.0]}})
    assert np.array_equal(found.switched.routing, found.vehicle.routing)
    assert float(found.switched.vertical_force) == 0.0 and float(found.vehicle.vertical_force) == 5.0


def test_the_log_of_a_target_passes_the_checks_of_the_diagnosis(tmp_path):
    """Written and read back it has no error, and shows the compass as biased as it is."""
    biased = read_scenario("biased", {"effects": {"heading_bias": {"angle": 0.5}}}, VEHICLE)

    def logged(scenario):
        make = lambda task, count: make_fleet("mujoco", VEHICLE, task, count, scenario=scenario, seed=0)  # noqa: E731
        return fly_target_log(make, VEHICLE, StationKeeping().for_evaluation(1.0), Excitation(2, 10.0), "target")

    log, straight = logged(biased), logged(Scenario("nominal"))
    again = read_flightlog(write_flightlog(log, tmp_path / "log.csv"), VEHICLE)
    assert not [finding for finding in again.findings if finding.severity is Severity.ERROR]
    turned = log.episodes[0].pose[:, 5] - straight.episodes[0].pose[:, 5]
    assert float(torch.from_numpy(turned).cos().mean()) == pytest.approx(0.8776, abs=0.02)  # cos 0.5


def test_training_on_starts_from_the_policy_and_never_ends_below_it(source, tmp_path):
    """With a learning rate of nearly nothing the weights stay; what is kept is no worse than the start."""
    target = read_scenario("told", {"effects": {"buoyancy": {"force": 8.0}}}, VEHICLE).vehicle_at(VEHICLE)
    task = replace(TASK, thruster_commands=True)
    ground = Ground(
        target, VEHICLE, {"buoyancy": {"force": [7.0, 9.0]}}, lambda: KnownVehicle(VEHICLE, target, TASK), "k"
    )
    tuning = FineTuning(total_frames=160, critic_frames=80, learning_rate=1e-9)
    same = fine_tune(source, ground, task, TINY, tuning, 0, "mujoco", tmp_path)
    for old, new in zip(source.module.parameters(), same.module.parameters(), strict=True):
        torch.testing.assert_close(old, new, atol=1e-5, rtol=0)
    better = fine_tune(source, ground, task, TINY, replace(tuning, learning_rate=1e-2), 0, "mujoco", tmp_path)
    assert better.metadata["result"]["best_m"] <= same.metadata["result"]["best_m"] + 1e-4
    assert better.metadata["hash"] != same.metadata["hash"]


def test_closing_trains_on_only_where_the_map_leaves_a_gap(tmp_path):
    """Swapped thrusters are undone by the map alone: nothing is left to train for, and the rehearsals say so."""
    swap = read_scenario("told", {"effects": {"thruster_swap": {"pair": [1, 2]}}}, VEHICLE)
    task = StationKeeping(episode_s=12.0)
    pilot = SourcePolicy(cast(Any, PID(task)), {"hash": "pid"})
    closed = close(Diagnosed(VEHICLE, swap, {}), pilot, task, 1.0, TINY, FineTuning(160, 0), 0, "mujoco", tmp_path)
    assert closed.tuned_m is None and not closed.tuned and closed.policy is pilot
    assert closed.mapped_m == pytest.approx(closed.nominal_m, abs=0.002)
    assert closed.before_m > closed.nominal_m + 0.02
