"""Whatever a file holds, the reader gives a log or one clear error."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog import FlightLogError, read_flightlog, write_flightlog
from auv_torchrl.flightlog.tables.columns import KNOWN
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.simulate import POSE_ONLY, simulated_logs

PAPER = load_vehicle("paper")
quick = settings(
    max_examples=150,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


def read_or_refuse(path) -> None:
    """Read a file; a log keeps its promises, an error is one sentence."""
    try:
        log = read_flightlog(path, PAPER)
    except FlightLogError as error:
        assert str(error)
        return
    assert log.episodes
    for episode in log.episodes:
        assert (np.diff(episode.t) > 0).all()
        assert np.isfinite(episode.commands).all()
        assert np.abs(episode.commands).max() <= 1
        measured = np.concatenate((episode.pose, episode.velocity), -1)
        assert (np.isfinite(measured).all(axis=0) | np.isnan(measured).all(axis=0)).all()
        assert len(episode.t) == len(episode.pose) == len(episode.velocity) == len(episode.commands)


@quick
@given(st.binary(max_size=400))
def test_any_bytes(tmp_path, content):
    """Random bytes."""
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    read_or_refuse(path)


header = st.lists(
    st.sampled_from([*KNOWN, *(f"cmd_{i}" for i in range(1, 7)), "", "spare", '"x"']), max_size=14, unique=True
)
entry = st.sampled_from(
    ["0", "1", "-1", "0.05", "1e308", "-1e308", "1e-320", "nan", "inf", "", "x", '"', "0x10", "é", "1_0"]
)


@quick
@given(header, st.lists(st.lists(entry, max_size=15), max_size=30))
def test_any_table(tmp_path, names, rows):
    """Known columns in any combination with any values and any shape."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(row) for row in [names, *rows]))
    read_or_refuse(path)


number = st.one_of(st.floats(), st.sampled_from([0.0, 1.0, -1.0, 1e300, 1e-300, np.nan, np.inf]))


@quick
@given(st.data(), st.integers(1, 80))
def test_any_numbers(tmp_path, data, rows):
    """A complete log of arbitrary numbers, some of its columns sound."""
    t = np.arange(rows) * 0.05
    columns = {"t": t, "x": 0.1 * t, "y": 0 * t, "z": 0 * t, "yaw": 0 * t, "u": 0 * t, "v": 0 * t, "r": 0 * t}
    columns |= {f"cmd_{i}": np.sin(i * t) for i in range(1, 7)}
    for name in data.draw(st.lists(st.sampled_from(sorted(columns)), max_size=4)):
        values = data.draw(st.lists(number, min_size=rows, max_size=rows))
        columns[name] = np.array(values)
    path = tmp_path / "log.parquet"
    pyarrow.parquet.write_table(pa.table(columns), path)
    read_or_refuse(path)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The bytes of a sound log in both formats."""
    log = replace(simulated_logs("paper", [{}], episodes=2, seconds=4.0)[0], axes=POSE_ONLY)
    folder = tmp_path_factory.mktemp("sound")
    return {suffix: write_flightlog(log, folder / f"log.{suffix}").read_bytes() for suffix in ("csv", "parquet")}


@quick
@given(st.data(), st.sampled_from(["csv", "parquet"]))
def test_any_damage(sound, tmp_path, data, suffix):
    """A sound file with bytes replaced, removed, repeated or cut off."""
    content = bytearray(sound[suffix])
    for _ in range(data.draw(st.integers(1, 5))):
        where = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.integers(0, 60))
        content[where : where + length] = data.draw(st.one_of(st.binary(max_size=60), st.just(b"\n"), st.just(b",")))
        if not content:
            break
    path = tmp_path / f"log.{suffix}"
    path.write_bytes(bytes(content))
    read_or_refuse(path)
