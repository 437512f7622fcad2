"""Small versions of the benchmarks of adaptation in flight and of the comparison."""

import json
from dataclasses import replace
from functools import partial
from typing import Any, cast

import pytest
import torch

from auv_torchrl.adaptation import load_adaptation_config
from auv_torchrl.adaptation.flight import cost_per_step
from auv_torchrl.adaptation.recovery import recoveries
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.ddr import PretrainingConfig
from auv_torchrl.ddr.store import load_or_pretrain
from auv_torchrl.evaluation import Metrics
from auv_torchrl.tasks import Lemniscate, StationKeeping
from auv_torchrl.vehicle import load_vehicle
from benchmarks.control import __main__ as bench_command
from benchmarks.control import methods, time_to_error, tracking
from benchmarks.control.comparison import cell
from benchmarks.control.comparison_tables import CLOSED, ORACLE, SOURCE, Cell, draw, report, share_closed
from benchmarks.control.fault_recovery import CONDITIONS, fly_fault, row
from benchmarks.control.least_delay import least_delays
from benchmarks.control.methods import METHODS, Bench
from benchmarks.control.source import shipped_scenario
from benchmarks.control.tasks import WAYS, by_scenario, flown, summary
from benchmarks.control.tracking import Course

VEHICLE = load_vehicle("paper")


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The swap, flown by a PID instead of a trained policy, for little longer than until errors count."""
    pilot = SourcePolicy(cast(Any, PID(StationKeeping())), {"hash": "pid"})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(methods, "StationKeeping", partial(StationKeeping, episode_s=11.0))
        yield Bench(VEHICLE, shipped_scenario("swap", VEHICLE), tmp_path_factory.mktemp("policies"), 2, pilot)


@pytest.mark.slow
def test_every_method_flies_the_same_starts(bench, monkeypatch):
    """All methods that train nothing fly a swap, and those that map commands beat the source policy."""
    few = PretrainingConfig(transitions=3000, iterations=100)  # models that are good enough to adapt a little
    monkeypatch.setattr(methods, "load_or_pretrain", partial(load_or_pretrain, config=few))
    monkeypatch.setattr(methods, "BUDGET", Excitation(episodes=2, episode_s=7.5))
    flights = {}
    for method in ("u_s", "PID with integral", "pulse test, fixed signs", "recursive least squares", "DDR, 4 channels",
                   "DDR to the thrusters", "online, in flight", "told the target (oracle)", "LQR", "adaptive LQR",
                   "L1 augmentation"):  # fmt: skip
        flights[method] = METHODS[method](bench).flight
        torch.testing.assert_close(flights[method].position[:, 0], flights["u_s"].position[:, 0])
    mean = {method: Metrics.of(flight).mean_m for method, flight in flights.items()}
    for method in ("DDR, 4 channels", "DDR to the thrusters", "online, in flight", "told the target (oracle)",
                   "adaptive LQR"):  # fmt: skip
        assert mean[method] < 0.8 * mean["u_s"], method


def test_a_package_that_the_benchmarks_lack_is_named_with_the_command_that_installs_it(monkeypatch, capsys):
    """Nothing is measured before everything is there to compare with."""
    monkeypatch.setattr(bench_command, "PACKAGES", ("torch", "no-such-package"))
    monkeypatch.setattr("sys.argv", ["bench", "comparison"])
    with pytest.raises(SystemExit):
        bench_command.main()
    message = capsys.readouterr().err
    assert "no-such-package is not installed" in message
    assert "pip install" in message


def test_a_cell_is_flown_once_for_the_same_starts(bench, tmp_path):
    """The second time it comes from its file; other starts are flown anew."""
    first = cell(bench, "u_s", tmp_path, fresh=False)
    (path,) = tmp_path.rglob("*.json")
    kept = json.loads(path.read_text())
    path.write_text(json.dumps({**kept, "mean_m": 7.0}))
    assert cell(bench, "u_s", tmp_path, fresh=False).mean_m == 7.0
    assert cell(bench, "u_s", tmp_path, fresh=True) == first
    assert cell(replace(bench, count=3), "u_s", tmp_path, fresh=False).mean_m != first.mean_m


@pytest.mark.slow
def test_an_agent_is_flown_on_a_task_alone_mapped_and_adapting(bench, tmp_path, monkeypatch):
    """Both adaptations undo a swap on a path; the second time the errors come from their file."""
    few = PretrainingConfig(transitions=3000, iterations=100)
    monkeypatch.setattr(tracking, "load_or_pretrain", partial(load_or_pretrain, config=few))
    course = Course(VEHICLE, Lemniscate(episode_s=12.0), 2)
    pilot = SourcePolicy(cast(Any, PID(course.task, vehicle=VEHICLE)), {"hash": "pid", "curve": [{"cpu_s": 3.0}]})
    means = flown(course, pilot, bench.scenario, tmp_path, bench.policies)
    assert max(means[way] for way in WAYS[1:]) < 0.8 * means["alone"]
    (path,) = tmp_path.rglob("*.json")
    path.write_text(path.read_text().replace(str(means["alone"]), "7.0"))
    again = flown(course, pilot, bench.scenario, tmp_path, bench.policies)
    assert again == {**means, "alone": 7.0}
    line = summary("lemniscate", "pid", pilot, {"alone": 0.02}, {"swap": again, "drag": dict.fromkeys(WAYS, 0.01)})
    assert line.startswith("| lemniscate | pid | 3 | 0.0200 | 3.50 | 1 of 2 |")
    assert f"| swap | {again['DDR from 4 s']:.4f} |" in by_scenario({"pid": {"swap": again}})


def test_the_report_says_how_much_of_the_gap_was_closed(tmp_path):
    """From 0.104 to 0.014 m where the oracle has 0.004: 90 %; a gap of a millimetre is none."""
    notes = {"verdict": "explained", "summary": "Thruster 1 is dead.", "prediction_closed": 0.97, "tuned": False}
    errors = {SOURCE: (0.104, 0.005), CLOSED: (0.014, 0.004), ORACLE: (0.004, 0.004)}
    table = {
        method: {s: Cell(e, e, e, 60.0, 1.0, notes) for s, e in zip(("payload", "drag"), pair, strict=True)}
        for method, pair in errors.items()
    }
    assert share_closed(table, "payload") == pytest.approx(0.9)
    assert share_closed(table, "drag") is None
    text = report(table, 10, 0.004)
    assert "| payload | 0.10 | 0.0140 | 0.0040 | 90% | 97% |" in text
    assert "Median share closed: 90% of 1 gaps" in text and "| drag | 0.0050 | 0.0040 | 0.0040 | – |" in text
    draw(table, tmp_path / "comparison.png")
    assert (tmp_path / "comparison.png").stat().st_size > 10_000


def test_a_fault_in_flight_gives_a_row_of_the_table():
    """Two vehicles meet a swap at different times, are judged, and the row says so."""
    flown, fault_s = fly_fault(VEHICLE, PID(StationKeeping()), "swap", next(iter(CONDITIONS)), 2, 26.0)
    assert fault_s[0] != fault_s[1]
    found = recoveries(flown, fault_s, VEHICLE)
    assert float(found.largest_m.max()) < 0.4
    least = least_delays(flown.flight, fault_s + found.felt_s, VEHICLE, load_adaptation_config())
    assert (least <= found.delay_s).all()  # no test is faster than the one that is told everything
    assert row("swap", "still water", found, least).count("|") == 13


@pytest.mark.parametrize("sensed", ["velocity", "pose"])
def test_the_adapter_takes_a_small_part_of_a_control_step(sensed):
    """At batch 1 the adapter's own CPU time stays far below the control step of 50 ms."""
    following, searching = cost_per_step(VEHICLE, load_adaptation_config(overrides={"sensed": sensed}), steps=60)
    assert following < 10.0
    assert searching < 10.0


def test_agents_that_race_to_an_error_stop_there():
    """At the smallest goal, with examinations on the way."""
    for config in time_to_error.configs():
        assert config.stop_below_m == min(time_to_error.GOALS_M) and config.stretches >= 10
