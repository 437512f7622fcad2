"""Benchmarks on logs of real vehicles, on tables like theirs."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.simulator import simulate
from benchmarks.real import __main__ as page
from benchmarks.real import haizhe

RUNS, ROWS = 40, 196
FLOWN = {haizhe.NORMAL: {}, haizhe.LOAD: {"buoyancy": {"force": 3.0}}, haizhe.DEPTH: {"depth_bias": {"offset": 0.2}}}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A file like the real one, of a vehicle of which all is known."""
    rng, columns = np.random.default_rng(0), {}
    pulses = np.full((RUNS, ROWS, 4), haizhe.STOPPED)
    pulses[:, 3:] = np.round(1200 + 3 * rng.standard_normal((RUNS, 1, 1)))
    for place, (name, values) in enumerate(FLOWN.items()):
        weight = values.get("buoyancy", {}).get("force", 0.0) + 0.3 * rng.standard_normal(RUNS)
        vehicles = batch(haizhe.own_vehicle(), [{**values, "buoyancy": {"force": float(own)}} for own in weight])
        commands = (pulses - haizhe.STOPPED) / haizhe.REACH
        flown = simulate(vehicles, commands, np.arange(ROWS + 1) / haizhe.RATE).reported
        depth = flown.position[:, :-1, 2] + 0.01 * rng.standard_normal((RUNS, ROWS))
        turning = -np.degrees(flown.velocity[:, :-1, 5]) + rng.standard_normal((RUNS, ROWS))
        own = {
            "run": np.repeat([f"{name}_{i}" for i in range(RUNS)], ROWS),
            "class": np.full(RUNS * ROWS, name),
            "time": np.repeat(100000 + 100 * (np.arange(RUNS) // 4 + 10 * (np.arange(RUNS) // 20)), ROWS) + place,
            "depth": depth.reshape(-1),
            "roll": 5.0 + rng.standard_normal(RUNS * ROWS),
            "pitch": rng.standard_normal(RUNS * ROWS),
            "voltage": np.repeat(12.0 + 0.2 * rng.standard_normal(RUNS), ROWS),
            "w_yaw": turning.reshape(-1),
            **{f"pwm{i + 1}": pulses[..., i].reshape(-1) for i in range(4)},
        }
        columns = {key: np.concatenate([columns[key], value]) if columns else value for key, value in own.items()}
    path = tmp_path_factory.mktemp("real") / haizhe.FILE
    path.parent.mkdir()
    pq.write_table(pa.table(columns), path)
    return path


def test_runs_of_known_faults_are_told_apart(table):
    """Of runs that the simulator flew, loads and depth sensors are found, and groups of eight are all right."""
    classes = haizhe.read_classes(table)
    assert [len(logs) for logs in classes.values()] == [2, 2, 2], "sessions are parted where nobody flew"
    scored = haizhe.score(classes, load_settings(), seed=1)
    shares = haizhe.shares(scored)
    assert shares["load, depth sensor or the rest"] > 0.9
    assert shares["groups of 8, damages merged"] == 1
    assert shares["normal runs called faulty"] <= 0.2
    assert len(list(haizhe.table(scored))) == 2 + len(FLOWN) + 1 + len(shares)


def test_what_is_absent_is_named(tmp_path, monkeypatch, capsys):
    """With no logs at hand, every part says what it lacks, and nothing is published by half."""
    monkeypatch.setattr("sys.argv", ["real", "--data", str(tmp_path)])
    page.main()
    shown = capsys.readouterr().out
    assert "run_11_40_38.csv" in shown
    assert "haizhe/train.parquet" in shown
    monkeypatch.setattr("sys.argv", ["real", "haizhe", "--publish"])
    with pytest.raises(SystemExit) as ended:
        page.main()
    assert ended.value.code == 2
