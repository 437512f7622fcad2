"""A recording is read back and holds what was flown."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from auv_torchrl.recording import ControlMap, record_run
from auv_torchrl.recording.body import ARROW_M_PER_N
from auv_torchrl.scenario import read_scenario
from auv_torchrl.vehicle import load_vehicle

RERUN = str(Path(sys.executable).parent / "rerun")


@pytest.fixture(scope="module")
def flown(pd_flight):
    nominal = load_vehicle("paper")
    scenario = read_scenario("reversed", {"effects": {"thruster_gain": {"gain_1": -1.0}}}, nominal)
    target = scenario.vehicle_at(nominal)
    flights = {"nominal": pd_flight(nominal), "u_s": pd_flight(nominal, scenario), "u_t": pd_flight(nominal)}
    return flights, {"nominal": nominal, "u_s": target, "u_t": target}


def read(path: Path) -> dict[str, list[pa.RecordBatch]]:
    """Record batches by entity, static ones too."""
    batches: dict[str, list[pa.RecordBatch]] = {}
    for chunk in RrdReader(path).stream():
        batches.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return batches


def column(batches: list[pa.RecordBatch], ending: str) -> list:
    """The values of the one column whose name ends so, over all batches."""
    found = [batch.column(name) for batch in batches for name in batch.schema.names if name.endswith(ending)]
    return [value for array in found for value in array.to_pylist()]


def test_a_recording_holds_poses_forces_errors_commands_and_the_map(flown, tmp_path):
    """What is read back equals what was flown, in seconds of the timeline ``time``."""
    flights, vehicles = flown
    control_map = ControlMap(np.diag([1.0, -2.0, 0.5, 1.0]), np.zeros(4), ("surge", "sway", "heave", "yaw"))
    record_run(tmp_path / "run.rrd", flights, vehicles, "# Result", control_map)
    entities = read(tmp_path / "run.rrd")
    shown = int(flights["u_s"].position_error.mean(dim=1).argmax())
    flight = flights["u_t"][shown]

    poses = entities["/world/u_t/start_1"]
    translation = np.array(column(poses, "Transform3D:translation"))[:, 0]
    np.testing.assert_allclose(translation, flight.position.numpy(), atol=1e-6)
    quaternion = np.array(column(poses, "Transform3D:quaternion"))[:, 0]
    np.testing.assert_allclose(np.roll(quaternion, 1, axis=-1), flight.quaternion.numpy(), atol=1e-6)
    seconds = [duration.total_seconds() for duration in column(poses, "time")]
    np.testing.assert_allclose(seconds, flight.time.numpy(), atol=1e-9)

    vectors = np.array(column(entities["/world/u_t/start_1/force"], "Arrows3D:vectors"))
    directions = vehicles["u_t"].thruster_direction
    np.testing.assert_allclose((vectors * directions).sum(-1), ARROW_M_PER_N * flight.thrust.numpy(), atol=1e-6)

    thrust = np.array(column(entities["/thrust/u_t"], "Scalars:scalars"))
    np.testing.assert_allclose(thrust, flight.thrust.numpy(), atol=1e-9)
    error = np.array(column(entities["/error/u_s/worst"], "Scalars:scalars"))[:, 0]
    np.testing.assert_allclose(error, flights["u_s"].position_error.amax(dim=0).numpy(), atol=1e-9)
    before = np.array(column(entities["/commands/sway/before"], "Scalars:scalars"))[:, 0]
    np.testing.assert_allclose(before, flight.action[:, 1].numpy(), atol=1e-6)
    assert "-2.00" in column(entities["/map/text"], "TextDocument:text")[0][0]
    assert {f"/world/{name}/paths" for name in flights} <= set(entities)


def test_a_recording_has_a_blueprint_and_passes_the_viewers_own_check(flown, tmp_path):
    """``rerun rrd verify`` accepts the file, and refuses it when it is cut."""
    flights, vehicles = flown
    record_run(tmp_path / "run.rrd", flights, vehicles, "# Result")
    assert RrdReader(tmp_path / "run.rrd").blueprints()

    def verify(path: Path) -> int:
        home = {"HOME": str(tmp_path), "RERUN_ANALYTICS": "0", "PATH": "/usr/bin:/bin"}
        return subprocess.run([RERUN, "rrd", "verify", path], env=home, capture_output=True).returncode

    assert verify(tmp_path / "run.rrd") == 0
    cut = tmp_path / "cut.rrd"
    cut.write_bytes((tmp_path / "run.rrd").read_bytes()[:-2000])
    assert verify(cut) != 0


def test_a_hundred_starts_stay_below_ten_megabytes(flown, tmp_path):
    """Only some starts are drawn, the others are in the statistics."""
    flights, vehicles = flown
    many = {name: flight.repeat(17, 1) for name, flight in flights.items()}
    record_run(tmp_path / "run.rrd", many, vehicles, "# Result")
    assert (tmp_path / "run.rrd").stat().st_size < 10e6


def test_an_existing_recording_is_not_overwritten(tmp_path):
    """The error says what to do."""
    (tmp_path / "run.rrd").write_text("mine")
    with pytest.raises(FileExistsError, match="another output folder"):
        record_run(tmp_path / "run.rrd", {}, {}, "")
    assert (tmp_path / "run.rrd").read_text() == "mine"


def test_the_nominal_flight_alone_is_recorded_without_a_map(flown, tmp_path):
    """A run without a scenario has one controller and no map."""
    flights, vehicles = flown
    record_run(tmp_path / "run.rrd", {"nominal": flights["nominal"]}, vehicles, "")
    entities = read(tmp_path / "run.rrd")
    assert "/world/nominal/start_1" in entities and not any(entity.startswith("/map") for entity in entities)
