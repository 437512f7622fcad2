"""The flight in which the vehicle changes is read back from a recording, with its markers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import torch
from rerun.chunk import RrdReader
from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.adaptation.flight import fly_adapting, gains
from auv_torchrl.adaptation.recovery import Happening, moments, recoveries
from auv_torchrl.authority import controlled_allocation
from auv_torchrl.ddr.transform import observing
from auv_torchrl.envs import TorchFleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.recording import OneFlight, record_run
from auv_torchrl.recording.flight import FAR, NEAR
from auv_torchrl.scenario import read_scenario
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

FAULT_S = 2.5


@pytest.fixture(scope="module")
def one(pd_policy) -> OneFlight:
    """A thruster turns the wrong way after 2.5 s of 13 s."""
    vehicle = load_vehicle("paper")
    task = replace(StationKeeping().for_evaluation(1.0), episode_s=13.0)
    thrusters = replace(task, thruster_commands=True)
    config = {"effects": {"thruster_gain": {"gain_1": -1.0, "start_s": FAULT_S}}}
    scenario = read_scenario("reversed", config, vehicle)
    starts = draw_starts(task, 1, seed=1)
    adapter = InFlightAdapter(vehicle, thrusters, load_adaptation_config(), 1)
    target = TorchFleet(vehicle, thrusters, 1, scenario=scenario, seed=0)
    fleet = TransformedEnv(target, observing(adapter, thrusters))
    adapted = fly_adapting(fleet, pd_policy, starts, task.steps)
    alone = fly(TorchFleet(vehicle, task, 1, scenario=scenario, seed=0), pd_policy, starts, task.steps)
    found = recoveries(adapted, torch.tensor([FAULT_S]), vehicle)
    nominal = controlled_allocation(vehicle)
    estimated = gains(adapted.effectiveness[0].double(), nominal)
    happened = moments(adapted, 0, {"thruster_gain begins": FAULT_S}, [found])
    return OneFlight(
        vehicle, adapted.of_start(0), alone.of_start(0), estimated, torch.ones_like(estimated), happened, "summary"
    )


@pytest.fixture(scope="module")
def entities(one, pd_flight, tmp_path_factory) -> dict[str, list[pa.RecordBatch]]:
    """Record batches by entity."""
    path: Path = tmp_path_factory.mktemp("recording") / "run.rrd"
    record_run(path, {"nominal": pd_flight(one.vehicle)}, {"nominal": one.vehicle}, "", one_flight=one)
    batches: dict[str, list[pa.RecordBatch]] = {}
    for chunk in RrdReader(path).stream():
        batches.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return batches


def timed(batches: list[pa.RecordBatch], ending: str) -> list[tuple[float, str]]:
    """Seconds and text of the column whose name ends so, in order of time; static ones have no time."""
    found = []
    for batch in batches:
        for name in batch.schema.names:
            if name.endswith(ending) and "time" in batch.schema.names:
                values, times = batch.column(name).to_pylist(), batch.column("time").to_pylist()
                found += [(at.total_seconds(), value[0]) for at, value in zip(times, values, strict=True)]
    return sorted(found)


def test_the_markers_stand_at_the_times_of_the_flight(one, entities):
    """Fault, alarm and settled map are lines of the log, in this order, each at its own second."""
    logged = timed(entities["/flight/moments"], "TextLog:text")
    expected = [(moment.time_s, f"{moment.happening.value}: {moment.text}") for moment in one.moments]
    assert [text for _, text in logged] == [text for _, text in expected]
    np.testing.assert_allclose([at for at, _ in logged], [at for at, _ in expected], atol=1e-6)
    kinds = [moment.happening for moment in one.moments]
    assert kinds.index(Happening.CHANGE) < kinds.index(Happening.NOTICED) < kinds.index(Happening.SETTLED)
    assert logged[0][0] == pytest.approx(FAULT_S)
    alarm = float(one.adapted.flight.time[one.adapted.alarm][0])
    points = timed(entities["/flight/error/moments/noticed"], "Scalars:scalars")
    assert points[0][0] == pytest.approx(alarm, abs=1e-6)


def test_states_change_when_the_flight_does(one, entities):
    """The vehicle at the fault, the adaptation at the alarm and when the map has settled, the distance at 5 cm."""
    vehicle = timed(entities["/flight/state/vehicle"], "StateChange:state")
    assert [state for _, state in vehicle] == ["nominal", "thruster_gain begins"]
    assert vehicle[1][0] == pytest.approx(FAULT_S)
    adaptation = timed(entities["/flight/state/adaptation"], "StateChange:state")
    assert [state for _, state in adaptation][:3] == ["following", "searching", "following"]
    settled = [moment.time_s for moment in one.moments if moment.happening is Happening.SETTLED]
    assert adaptation[2][0] == pytest.approx(settled[0], abs=1e-6)
    distance = timed(entities["/flight/state/distance"], "StateChange:state")
    error = one.adapted.flight.position_error
    crossed = 1 + int(((error[1:] < 0.05) != (error[:-1] < 0.05)).sum())
    assert len(distance) == crossed and distance[0][1] == FAR and distance[1][1] == NEAR


def test_curves_are_those_of_the_flight(one, entities):
    """Error, gains and the detector's sum, read back as flown."""

    def curves(entity: str) -> np.ndarray:
        found = [batch.column(name) for batch in entities[entity] for name in batch.schema.names if "scalars" in name]
        return np.array([value for column in found for value in column.to_pylist()])

    error = one.adapted.flight.position_error.double().numpy()
    np.testing.assert_allclose(curves("/flight/error/with_the_adaptation")[:, 0], error, atol=1e-9)
    np.testing.assert_allclose(curves("/flight/gain/estimated"), one.gains.numpy(), atol=1e-9)
    np.testing.assert_allclose(curves("/flight/statistic")[:, 0], one.adapted.statistic.numpy(), atol=1e-6)
    assert "/flight/world/vehicle/hull" in entities
