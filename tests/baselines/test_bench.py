"""Small versions of the benchmarks of adaptation in flight and of the comparison."""

import pytest
import torch
import yaml

from auv_torchrl.agents.pid import PID
from auv_torchrl.envs import RegulationTask
from auv_torchrl.evaluation import Metrics
from auv_torchrl.online import load_online_config
from auv_torchrl.online.cost import cost_per_step
from auv_torchrl.online.recovery import recoveries
from auv_torchrl.paths import config_path
from auv_torchrl.scenario import read_scenario
from auv_torchrl.vehicle import load_vehicle
from bench.comparison import METHODS, Bench, draw, line
from bench.fault_recovery import CONDITIONS, fly_fault, row

VEHICLE = load_vehicle("paper")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The swap, flown by a PID instead of a trained policy."""
    swap = read_scenario("swap", yaml.safe_load(config_path("scenario", "swap").read_text()), VEHICLE)
    return Bench(VEHICLE, swap, tmp_path_factory.mktemp("policies"), 2, PID(RegulationTask()))


@pytest.mark.slow
def test_every_method_flies_the_same_starts_and_fills_the_table(bench, tmp_path):
    """All methods that train nothing fly a swap, and those that map commands beat the source policy."""
    table = {}
    for method, attempt in METHODS.items():
        done = attempt(bench)
        table[method] = {"swap": (Metrics.of(done.flight), done)}
    first = table["u_s"]["swap"][1].flight.position[:, 0]
    for results in table.values():
        torch.testing.assert_close(results["swap"][1].flight.position[:, 0], first)
    mean = {method: results["swap"][0].mean_m for method, results in table.items()}
    for method in ("DDR, 4 channels", "DDR to the thrusters", "online, in flight", "true map (oracle)"):
        assert mean[method] < 0.8 * mean["u_s"], method
    assert line("u_s", table["u_s"]).count("|") == 5
    draw(table, tmp_path / "comparison.png")
    assert (tmp_path / "comparison.png").stat().st_size > 10_000


def test_a_fault_in_flight_gives_a_row_of_the_table():
    """Two vehicles meet a swap at different times, are judged, and the row says so."""
    flown, fault_s = fly_fault(VEHICLE, PID(RegulationTask()), "swap", next(iter(CONDITIONS)), 2, 26.0)
    assert fault_s[0] != fault_s[1]
    found = recoveries(flown, fault_s, VEHICLE)
    assert float(found.largest_m.max()) < 0.4
    assert row("swap", "still water", found).count("|") == 12


@pytest.mark.parametrize("sensed", ["velocity", "pose"])
def test_the_adapter_takes_a_small_part_of_a_control_step(sensed):
    """At batch 1 the adapter's own CPU time stays far below the control step of 50 ms."""
    following, searching = cost_per_step(VEHICLE, load_online_config(overrides={"sensed": sensed}), steps=60)
    assert following < 10.0
    assert searching < 10.0
