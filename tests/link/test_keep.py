"""What is kept of flights through the link can be read, diagnosed and looked at."""

import numpy as np
import pytest
from pyarrow import csv
from rerun.chunk import RrdReader

from auv_torchrl.flightlog import Severity, read_flightlog
from auv_torchrl.flightlog.writer import GrowingLog
from auv_torchrl.link import keep
from auv_torchrl.link.keep import FLIGHT, TRUTH, Keeper
from auv_torchrl.link.view import RECORDING, Viewer
from auv_torchrl.scenario import read_scenario
from auv_torchrl.sensors import FELT, MOTION
from auv_torchrl.simulator import simulate

EFFECTS = {"thruster_gain": {"gain_1": -1.0}, "depth_bias": {"offset": 0.5}}
FRAMES, SECOND = 300, 240  # 0.75 s and 0.6 s; a log reader leaves out shorter stretches than 0.5 s


@pytest.fixture(scope="module")
def pwm():
    """PWM (T, 16) of a flight."""
    return np.random.default_rng(0).integers(1100, 1900, (FRAMES, 16))


@pytest.fixture
def kept(wire, vehicle, tmp_path, pwm, monkeypatch):
    """The folder of two flights, the second shorter, with an effect on a thruster and one on a sensor."""
    monkeypatch.setattr(keep, "_ROWS", 70)  # written in several pieces
    observers = [Keeper(tmp_path), Viewer(vehicle, False, tmp_path)]
    link = wire(EFFECTS, observers)
    for count in (FRAMES, SECOND):
        for frame in range(count):
            link.send(frame, pwm[frame])
    for observer in observers:
        observer.close()
    return tmp_path


def columns(path, names):
    """Some columns (T, k) of the first episode of a file."""
    table = csv.read_csv(path)
    values = np.stack([table.column(name).to_numpy() for name in names], axis=-1)
    return values[table.column("episode").to_numpy() == 0]


def test_the_flight_log_is_one_of_the_project(kept, vehicle, pwm):
    """An episode for each start of the firmware, commands as sent, what the sensors report; read without an error."""
    log = read_flightlog(kept / FLIGHT, vehicle)
    assert [episode.duration for episode in log.episodes] == pytest.approx([FRAMES / 400, SECOND / 400], abs=0.06)
    assert not [finding for finding in log.findings if finding.severity is Severity.ERROR]
    assert set(log.axes) == {*MOTION, *FELT}
    commands = columns(kept / FLIGHT, [f"cmd_{n}" for n in range(1, 9)])
    np.testing.assert_allclose(commands, (pwm[:, :8] - 1500) / 400, atol=1e-6)
    reported, true = (columns(kept / name, ["t", "z"]) for name in (FLIGHT, TRUTH))
    np.testing.assert_allclose(true[:, 0], np.arange(FRAMES) / 400, atol=1e-6)
    np.testing.assert_allclose(reported - true, np.broadcast_to((0.0, 0.5), (FRAMES, 2)), atol=2e-6)


def test_the_truth_is_what_the_vehicle_did(kept, vehicle, pwm):
    """What ``simulate`` makes of the commands of the log; the depth that a sensor got wrong is right."""
    scenario = read_scenario("test", {"effects": EFFECTS}, vehicle)
    commands = (pwm[None, :, :8] - 1500) / 400
    states = simulate(vehicle, commands, np.arange(FRAMES + 1) / 400, scenario=scenario).states[0]
    true = columns(kept / TRUTH, [*MOTION[:3], *MOTION[6:]])
    np.testing.assert_allclose(true, states[:-1, [0, 1, 2, *range(7, 13)]], atol=1e-6)


def test_a_log_grows_in_whole_rows_and_replaces_none(tmp_path):
    """Whenever the process ends, there is a header and what was written."""
    path = tmp_path / "log.csv"
    log = GrowingLog(path)
    log.write({"t": np.array([0.0, 0.1234567])})
    assert path.read_text().splitlines() == ['"t"', "0.0", "0.123457"]
    log.write({"t": np.array([1.0])})
    log.close()
    assert path.read_text().splitlines()[-1] == "1.0"
    with pytest.raises(FileExistsError):
        GrowingLog(path)


def test_a_recording_shows_the_vehicle_its_commands_and_its_starts(kept):
    """On a timeline that goes on where the vehicle is placed anew."""
    entities, times = set(), []
    for chunk in RrdReader(kept / RECORDING).stream():
        entities.add(chunk.entity_path)
        if chunk.entity_path == "/world/vehicle":
            times += chunk.to_record_batch().column("time").cast("int64").to_pylist()
    assert {"/world/vehicle", "/world/vehicle/force", "/world/path", "/command", "/thrust", "/happened"} <= entities
    assert times == sorted(set(times)) and times[-1] > FRAMES / 400 * 1e9


@pytest.mark.parametrize("where", ["not an address", "http://"])
def test_a_viewer_that_cannot_be_is_refused(vehicle, where):
    """With what can be given."""
    with pytest.raises(ValueError, match="give rerun=true"):
        Viewer(vehicle, where, None)
