"""The table and the picture over many runs."""

import json

import pytest

from auv_torchrl.experiment.results import read_results
from auv_torchrl.experiment.summary import PICTURE, TABLE, console_table, groups, summarize


def result(scenario: str, seed: int, u_t: float | None, box_m: float = 1.0, **changes) -> dict:
    def metrics(mean: float | None) -> dict:
        worst = None if mean is None else 2 * mean
        return {"mean_m": mean, "std_m": 0.0, "p95_m": worst, "worst_m": worst, "settling_s": 3.0}

    return {
        "scenario": scenario, "vehicle": "paper", "seed": seed, "box_m": box_m, "starts": 4, "u_s": metrics(0.4),
        "u_t": metrics(u_t), "nominal": metrics(0.005), "target_data_s": 4.0, "fit_s": 0.01, "train_s": 30.0,
        "feasible": True, "reason": None, "in_flight": None, **changes,
    }  # fmt: skip


def test_the_table_has_each_seed_their_median_and_the_worst(tmp_path):
    """Seeds in order whatever the order of the runs, and the paper's number beside them."""
    runs = [result("swap", 2, 0.009), result("swap", 0, 0.004), result("swap", 1, 0.006)]
    text = summarize(runs, tmp_path)
    row = text.splitlines()[2]
    assert "0.019 | 0.0040 0.0060 0.0090 | 0.0060 | 0.0090 | 0.0180 |" in row
    assert (tmp_path / TABLE).read_text() == text + "\n"
    assert (tmp_path / PICTURE).stat().st_size > 1000


def test_infeasible_and_diverged_runs_are_in_the_table(tmp_path):
    """An infeasible one says so; an error without bound is inf and not left out."""
    dead = result("two_dead", 0, None, feasible=False, reason="rank 3") | {"u_t": None}
    lost = result("swap", 0, None)
    text = summarize([dead, lost], tmp_path)
    assert "| infeasible |" in text and "inf" in text.splitlines()[3]


def test_the_table_of_the_console_fits_80_columns_and_says_the_same():
    """Long names, infeasible and diverged runs, vehicles and boxes included."""
    runs = [result("swap", seed, u_t) for seed, u_t in enumerate((0.004, 0.009, 0.006))]
    runs += [result("two_dead", 0, None, feasible=False, reason="rank 3") | {"u_t": None}, result("cycle", 0, None)]
    runs += [result("reversed_and_dead+sensor_noise", 0, 0.1, box_m=12.5, vehicle="bluerov2_heavy")]
    table = console_table(runs)
    assert max(map(len, table.splitlines())) <= 80
    rows = {line.split("  ")[0]: line for line in table.splitlines()}
    assert "40.0 cm    6.00 mm    9.00 mm" in rows["swap"]
    assert "infeasible" in rows["two dead"] and "inf" in rows["cycle"]
    assert "bluerov2_heavy, starts within ±12.5 m" in table


def test_boxes_and_vehicles_are_kept_apart():
    """A row each."""
    runs = [result("swap", 0, 0.1), result("swap", 0, 0.2, box_m=2.0), result("swap", 0, 0.3, vehicle="bluerov2")]
    assert len(groups(runs)) == 3


def test_results_are_read_in_the_order_of_the_job_numbers(tmp_path):
    """10 comes after 9."""
    for number in (10, 9, 1):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "results.json").write_text(json.dumps({"seed": number}))
    assert [run["seed"] for run in read_results(tmp_path)] == [1, 9, 10]


def test_a_missing_key_is_an_error_not_a_gap(tmp_path):
    """A file that is no result of ours does not pass for one."""
    with pytest.raises(KeyError):
        summarize([{"scenario": "swap", "vehicle": "paper", "box_m": 1.0, "seed": 0}], tmp_path)


def test_the_flight_with_the_slowest_recovery_stands_in_the_table(tmp_path):
    """Of two seeds with two changes each the worst; never where 10 % never came back; a dash where none was flown."""

    def flown(*changes: tuple[float, float | None]) -> dict:
        return {"changes": [{"noticed": share, "recovery_s": {"p90": back}} for share, back in changes]}

    runs = [result("swap", 0, 0.004, in_flight=flown((1.0, 0.0), (0.9, 2.5)))]
    runs += [result("swap", 1, 0.004, in_flight=flown((1.0, 1.0), (1.0, 0.5)))]
    runs += [result("cycle", 0, 0.004, in_flight=flown((1.0, None))), result("reversed", 0, 0.004)]
    rows = {row.split(" | ")[0]: row for row in summarize(runs, tmp_path).splitlines()}
    assert rows["| swap"].endswith("| 90\u202f% | 2.5 |")
    assert rows["| cycle"].endswith("| 100\u202f% | never |")
    assert rows["| reversed"].endswith("| – | – |")
