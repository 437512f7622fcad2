"""Whole runs with a policy that has learnt next to nothing: what they leave behind, not how well they fly."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf

from auv_torchrl.agents.config import AGENTS
from auv_torchrl.command import BadInput
from auv_torchrl.command.chosen import scenario_name
from auv_torchrl.evaluation import Metrics, fly
from auv_torchrl.experiment.run import fit_map, fly_adapted, linear_map, run, source_policy
from auv_torchrl.paths import PROJECT
from tests.experiment.conftest import TINY

FIGURES = {"trajectories.png", "errors.png", "forces.png", "distribution.png", "flight.png"}
FILES = {"results.json", "run.rrd"} | FIGURES
ADAPTED = FILES | {"adapter.safetensors"}
METRICS = {"mean_m", "std_m", "p95_m", "worst_m", "settling_s"}


def train(*arguments: str, **options) -> subprocess.CompletedProcess:
    command = [sys.executable, str(PROJECT / "train.py"), *arguments]
    return subprocess.run(command, capture_output=True, text=True, **options)


@pytest.fixture(scope="module")
def commanded(policies, tmp_path_factory):
    """What the command line says of a run with two scenarios, and its folder."""
    folder = tmp_path_factory.mktemp("commanded") / "out"
    done = train("+scenario=[thruster_gain,swap]", *TINY, f"policies={policies}", f"output={folder}", "seed=0")
    assert done.returncode == 0, done.stderr
    return done.stdout, folder


def test_the_command_line_composes_scenarios_and_puts_everything_where_one_says(commanded):
    """One process, two scenarios, output=DIR: table on the console, resolved config and versions beside the results."""
    said, folder = commanded
    assert "── 7/7" in said and "\n| u_t  " in said
    assert {path.name for path in folder.iterdir()} == ADAPTED | {"config.yaml", "run.json", "train.log"}
    config = OmegaConf.load(folder / "config.yaml")
    assert set(config.scenario.effects) == {"thruster_gain", "thruster_swap"} and config.starts == 4
    about = json.loads((folder / "run.json").read_text())
    assert about["version"] and about["packages"]["torch"] and "starts=4" in about["overrides"]


def test_a_run_leaves_results_figures_and_a_recording(commanded):
    """results.json has every key that the format names, and both forms of u_t."""
    results = json.loads((commanded[1] / "results.json").read_text())
    assert results["scenario"] == "thruster_gain+swap" and results["vehicle"] == "paper" and results["feasible"]
    assert (results["seed"], results["box_m"], results["starts"]) == (0, 1.0, 4)
    assert all(set(results[name]) >= METRICS for name in ("u_s", "u_t", "nominal"))
    assert results["target_data_s"] == pytest.approx(2.0) and results["fit_s"] > 0 and results["train_s"] > 0
    assert results["u_t"] == results["u_t_forms"]["short"] != results["u_t_forms"]["long"]


def test_a_path_is_flown_adapted_drawn_and_recorded_whatever_agent_has_learnt_it(experiment, tmp_path):
    """A helix by another agent than SAC, broken in MuJoCo, leaves the same files, and the results name the task."""
    run(
        experiment("reversed", "task=helix", "task.episode_s=11", "starts=2", "agent=gradient", "backend=mujoco"),
        tmp_path,
    )
    assert {path.name for path in tmp_path.iterdir()} == ADAPTED
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["feasible"] and results["u_t"] is not None
    assert results["task"] == "helix" and results["in_flight"] is not None


@pytest.mark.thorough
@pytest.mark.parametrize("agent", [name for name in AGENTS if name != "sac"])
def test_every_agent_flies_a_whole_run(experiment, tmp_path, agent):
    """What another agent than SAC has learnt is broken, adapted and flown in MuJoCo by the same command."""
    results = run(experiment("swap", f"agent={agent}", "backend=mujoco"), tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == ADAPTED
    assert results.feasible and results.u_t is not None


def test_an_infeasible_scenario_is_declared_with_its_rank_and_u_s_is_still_flown(experiment, tmp_path):
    """No u_t, no error, and the reason in the results."""
    results = run(experiment("two_dead"), tmp_path)
    saved = json.loads((tmp_path / "results.json").read_text())
    assert saved["feasible"] is False and "rank 3" in saved["reason"] and saved["reason"] in results.table()
    assert saved["u_t"] is None and saved["u_s"]["mean_m"] > 0
    assert {path.name for path in tmp_path.iterdir()} == FILES


@pytest.fixture(scope="module")
def without_a_flight(experiment, tmp_path_factory):
    """Results and folder of a run that does not break the vehicle in flight."""
    folder = tmp_path_factory.mktemp("without_a_flight")
    return run(experiment("two_reversed", "flight.fly=false"), folder), folder


def test_the_flight_can_be_left_out(without_a_flight):
    """No figure of it, and null in the results."""
    results, folder = without_a_flight
    assert results.in_flight is None and {path.name for path in folder.iterdir()} == FILES - {"flight.png"}
    assert json.loads((folder / "results.json").read_text())["in_flight"] is None


@pytest.mark.thorough
def test_two_reversed_thrusters_need_the_map_to_the_thrusters(experiment, without_a_flight, tmp_path):
    """The channels have lost rank, the thrusters have not: the reason names the remedy, and the remedy works."""
    channels, _ = without_a_flight
    assert not channels.feasible and "adapter=thrusters" in str(channels.reason)
    results = run(experiment("two_reversed", "adapter=thrusters", "flight.fly=false"), tmp_path)
    assert results.feasible and results.u_t is not None


def test_without_a_scenario_the_nominal_vehicle_alone_is_flown(experiment, tmp_path):
    """u_s and u_t are null."""
    results = run(experiment("nominal"), tmp_path)
    assert results.u_s is None and results.u_t is None and results.nominal.mean_m > 0


def test_u_t_flies_as_u_s_does_on_the_nominal_vehicle(experiment, pd_policy):
    """With a capable policy the fitted map undoes a swap: the same starts, nearly the same errors."""
    swapped = experiment("swap", "adapter.target_data_s=4", "starts=12")
    policy = source_policy(swapped)
    object.__setattr__(policy, "module", pd_policy)
    adaptation = fit_map(swapped, policy)
    np.testing.assert_allclose(linear_map(adaptation.adapter).matrix[2], (0, 0, 1, 0), atol=0.1)
    adapted = Metrics.of(fly_adapted(swapped, policy, adaptation, "short"))
    nominal = experiment("nominal", "starts=12")
    healthy = Metrics.of(fly(nominal.fleet(12), pd_policy, nominal.starts, nominal.exam.steps))
    broken = Metrics.of(fly(swapped.fleet(12, swapped.scenario), pd_policy, swapped.starts, swapped.exam.steps))
    assert adapted.mean_m < healthy.mean_m + 0.02 < broken.mean_m


def test_the_policy_and_the_models_are_trained_once(experiment, policies, tmp_path):
    """A second scenario with the same source takes both from the store, byte for byte the same."""
    first = source_policy(experiment("swap"))
    fit_map(experiment("swap"), first)
    before = {path: path.stat().st_mtime_ns for path in policies.rglob("*.safetensors")}
    again = source_policy(experiment("cycle"))
    fit_map(experiment("cycle"), again)
    after = {path: path.stat().st_mtime_ns for path in policies.rglob("*.safetensors")}
    assert before == after and len(before) >= 2
    for old, new in zip(first.module.parameters(), again.module.parameters(), strict=True):
        assert torch.equal(old, new)


def test_damaged_models_say_which_file_to_move_away(experiment, policies, tmp_path):
    """Nothing is trained over them."""
    fit_map(experiment("swap"), source_policy(experiment("swap")))
    shutil.copytree(policies, tmp_path / "store")
    swapped = experiment("swap", f"policies={tmp_path / 'store'}")
    (damaged,) = (tmp_path / "store").glob("*.models.safetensors")
    damaged.write_bytes(damaged.read_bytes()[:100])
    (tmp_path / "out").mkdir()
    with pytest.raises(BadInput, match="damaged.*move the file away"):
        run(swapped, tmp_path / "out")
    assert damaged.stat().st_size == 100


def test_a_damaged_policy_says_which_folder_to_move_away(experiment, policies, tmp_path):
    """It is not trained over."""
    source_policy(experiment("swap"))
    shutil.copytree(policies, tmp_path / "store")
    for weights in (tmp_path / "store").glob("*/policy.safetensors"):
        weights.write_bytes(weights.read_bytes()[:50])
    with pytest.raises(BadInput, match="damaged.*move the folder away"):
        run(experiment("swap", f"policies={tmp_path / 'store'}"), tmp_path)


@pytest.mark.parametrize(
    ("choices", "overrides", "name"),
    [
        ({"vehicle": "paper"}, ["seed=1"], "nominal"),
        ({"scenario": "swap"}, ["+scenario=swap"], "swap"),
        ({}, ["+scenario=[thruster_gain,swap]"], "thruster_gain+swap"),
        ({}, ["+scenario.effects.current.north=0.2", "+scenario.effects.current.east=0.1"], "custom"),
        ({"scenario": "swap"}, ["+scenario=swap", "scenario.effects.thruster_swap.pair=[1,3]"], "swap+custom"),
    ],
)
def test_a_run_is_called_by_its_scenarios(choices, overrides, name):
    """One, several, or changes given on the command line."""
    assert scenario_name(choices, overrides) == name


@pytest.mark.thorough
def test_a_sweep_in_parallel_trains_one_policy_per_seed_and_ends_with_one_table(policies, tmp_path):
    """The infeasible scenario does not stop it."""
    sweep = ["-m", "+scenario=swap,two_dead", "seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
    store = tmp_path / "store"
    store.mkdir()
    for models in policies.glob("*.models.safetensors"):
        shutil.copy(models, store)  # F and R depend on no seed
    done = train(*sweep, *TINY, "flight.fly=false", f"policies={store}", f"output={tmp_path / 'sweep'}", cwd=PROJECT)
    assert done.returncode == 0, done.stderr
    assert len(list(store.glob("*/policy.safetensors"))) == 2
    table = (tmp_path / "sweep" / "summary.md").read_text()
    assert "| swap | paper |" in table and "infeasible" in table
    assert "\nswap  " in done.stdout and "4 of 4 runs finished" in done.stdout and "── " not in done.stdout
    assert (tmp_path / "sweep" / "summary.png").stat().st_size > 0
    assert len(list((tmp_path / "sweep").rglob("results.json"))) == 4


def test_ctrl_c_ends_with_one_line_and_the_exit_code_of_an_interrupt(tmp_path):
    """Not with a traceback."""
    arguments = [*TINY, "agent.total_frames=4000000", f"policies={tmp_path}", f"output={tmp_path / 'out'}"]
    process = subprocess.Popen(
        [sys.executable, str(PROJECT / "train.py"), *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    checkpoint = None
    while checkpoint is None and process.poll() is None:
        time.sleep(0.05)  # leaves the processor to it
        checkpoint = next(Path(tmp_path).glob("*.training/checkpoint.pt"), None)
    os.kill(process.pid, signal.SIGINT)
    _, error = process.communicate()
    assert process.returncode == 130
    assert "Traceback" not in error and "run the same command to go on" in error


def test_a_vehicle_that_lacks_an_axis_is_refused_when_the_config_is_read(experiment):
    """Before anything is trained, with the name of the vehicle and of what it lacks."""
    one = "vehicle.thrusters={position:[[-0.5,0,0]],direction:[[1,0,0]]}"
    with pytest.raises(ValueError, match="vehicle bluerov2: its thrusters push surge both ways.*sway, heave and yaw"):
        experiment("nominal", "vehicle=bluerov2", one, "vehicle.mixer=[[1,0,0,0,0,0]]")


def test_a_policy_of_thruster_commands_flies_the_nominal_vehicle_alone(experiment, tmp_path):
    """Roll and pitch are followed by thruster commands; what adapts maps channels, and refuses them with a sentence."""
    six = ("task=lemniscate", "task.attitude=true", "task.pitch=0.2", "task.thruster_commands=true", "starts=2")
    run(experiment("nominal", *six, "vehicle=bluerov2_heavy"), tmp_path)
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["nominal"]["attitude_rad"] > 0 and results["task"] == "lemniscate"
    with pytest.raises(ValueError, match="without .scenario"):
        experiment("swap", *six)
