"""Vehicles that log what a set of sensors measures: flown as they say, and judged by what they can show."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.flightlog import read_flightlog, write_columns
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.vehicle import load_vehicle
from benchmarks import published
from benchmarks.blind.flights.cases import draw_cases
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.foreign_heavy import ForeignHeavy
from benchmarks.blind.flights.mujoco_plant import MujocoPlant
from benchmarks.blind.flights.pilots import Autopilots
from benchmarks.blind.flights.plant import Influences, Slack
from benchmarks.blind.flights.sensor_sets import FAULTS, SENSOR_SETS, WEAK, draw_fault
from benchmarks.blind.scores.judge import NO_MARK, judge
from benchmarks.blind.scores.report import markdown, publish, section
from benchmarks.blind.scores.score_sensors import set_numbers, set_tables
from benchmarks.blind.seal import hand_over
from tests.benchmarks.test_scoring import blind_eye, perfect

VEHICLE = load_vehicle("bluerov2_heavy")
SHARES = {"thruster": 3.0, "load": 2.0, "depth_bias": 1.0, "no_gap": 1.0, "no_gap_slack": 1.0}


def swim(plant, seconds=6.0):
    """What vehicles report, (steps, rows, 12), under smooth commands that tilt them; every four fly alike."""
    rng = np.random.default_rng(0)
    again = np.arange(plant.rows) % 4
    start = rng.uniform(-1, 1, (4, 3)), rng.uniform(-3, 3, 4), rng.uniform(-0.2, 0.2, (4, 4))
    plant.reset(*(part[again] for part in start))
    size, rate, phase = (rng.uniform(low, high, (4, 8))[again] for low, high in ((0.1, 0.3), (0.3, 2.0), (0.0, 6.0)))
    seen = []
    for step in range(round(seconds / CONTROL_DT)):
        seen.append(np.concatenate(plant.reported(), axis=1))
        plant.step(size * np.sin(rate * step * CONTROL_DT + phase), Influences.none(plant.rows, 8))
    return np.stack(seen)


@pytest.fixture(scope="module")
def flown_in_both():
    """What both simulators report by fault, of vehicles with slack; behind them, foreign vehicles without."""
    rows = {fault: slice(4 * i, 4 * i + 4) for i, fault in enumerate((None, *FAULTS))}
    loose = slice(0, 4 * len(rows))
    plants = MujocoPlant(VEHICLE, loose.stop, CONTROL_DT), ForeignHeavy(loose.stop + 4, CONTROL_DT)
    for plant in plants:
        plant.loosen(loose, Slack.draw(np.random.default_rng(1), 0.1, 8))
        for fault in FAULTS:
            for name, values in draw_fault(fault, VEHICLE, np.random.default_rng(3)).items():
                plant.change(rows[fault], name, values)
    mujoco, foreign = (swim(plant) for plant in plants)
    return {fault: (mujoco[:, part], foreign[:, part], foreign[:, loose.stop :]) for fault, part in rows.items()}


@pytest.mark.parametrize("fault", [None, *FAULTS])
def test_the_two_simulators_agree_on_a_heavy_vehicle(flown_in_both, fault):
    """Two codes that share nothing fly slack and every fault to the same motion, and the fault is not nothing."""
    mujoco, foreign, nominal = flown_in_both[fault]
    apart = mujoco - foreign
    apart[..., 3:6] = np.angle(np.exp(1j * apart[..., 3:6]))
    assert np.abs(apart).max() < 5e-4
    assert np.abs(foreign[..., 3:5]).max() > 1.0  # it tilts, so that all terms act
    assert np.abs(foreign - nominal).max() > 0.05


def test_the_foreign_heavy_vehicle_refuses_what_it_does_not_know():
    """An unknown effect or parameter is an error, not a flight without it."""
    with pytest.raises(ValueError, match="no effect 'kelp'"):
        ForeignHeavy(1, CONTROL_DT).change(slice(0, 1), "kelp", {})
    with pytest.raises(ValueError, match="no parameters"):
        ForeignHeavy(1, CONTROL_DT).change(slice(0, 1), "buoyancy", {"force": 1.0, "up": 0.2})


def test_an_autopilot_levels_and_holds():
    """A sound vehicle under the autopilot stays nearer to level than one that is steered alone, and does not dive."""
    plant, rng = ForeignHeavy(4, CONTROL_DT), np.random.default_rng(5)
    pilot = Autopilots(VEHICLE, np.arange(4) < 2, 20.0, rng)
    plant.reset(np.zeros((4, 3)), np.zeros(4), np.zeros((4, 4)))
    tilts, depths = [], []
    for step in range(400):
        pose = plant.reported().pose
        tilts.append(np.abs(pose[:, 3:5]))
        depths.append(pose[:, 2])
        plant.step(pilot.commands(step * CONTROL_DT, pose, CONTROL_DT), Influences.none(4, 8))
    assert np.mean(tilts) < 0.15
    assert np.abs(np.array(depths)[:, :2]).max() < 2.0


def test_a_weak_thruster_is_weak_and_any_of_them():
    """Gains of at most 0.6, of every thruster in turn."""
    seen = {}
    for seed in range(60):
        ((_, gains),) = draw_fault("weak thruster", VEHICLE, np.random.default_rng(seed)).items()
        seen.update({name: gain for name, gain in gains.items() if gain != 1.0})
    assert len(seen) == 8
    assert all(WEAK[0] <= gain <= WEAK[1] <= 0.6 for gain in seen.values())


@pytest.fixture(scope="module")
def flown_with_all():
    """Short flights with every fault, as each set of sensors reports them, by set; all fly at once."""
    cases = [case for sensors in SENSOR_SETS for case in draw_cases(9, SHARES, 1, sensors)]
    short = {"plant": "foreign", "episodes": 2, "episode_s": 12.0}
    flights = fly([replace(case, number=i, **short) for i, case in enumerate(cases, 1)], VEHICLE, seed=2)
    return {name: [own for own in flights if own[1]["sensors"] == name] for name in SENSOR_SETS}


@pytest.fixture(params=SENSOR_SETS)
def flown(flown_with_all, request):
    """A set of sensors, and the flights with it."""
    return request.param, flown_with_all[request.param]


def test_a_log_holds_what_the_set_measures(flown, tmp_path):
    """Its channels and no other, each at its own rate, held in between, with its noise."""
    sensors, flights = flown
    channels = SENSOR_SETS[sensors].channels
    log, label = flights[0]
    assert label["sensors"] == sensors
    for episode in log.episodes:
        for axis, column in zip(CHANNELS, episode.values.T, strict=True):
            if axis not in channels:
                assert np.isnan(column).all()
                continue
            fresh = np.flatnonzero(np.diff(column)) + 1
            assert (fresh % channels[axis].every == 0).all() and len(fresh) > 0.9 * len(column) / channels[axis].every
    write_columns(hand_over(log, label).log, tmp_path / "log.csv")
    read = read_flightlog(tmp_path / "log.csv", VEHICLE)
    assert read.axes == SENSOR_SETS[sensors].axes
    held = {axis for finding in read.findings if finding.code == "held_samples" for axis in finding.columns}
    assert held == {axis for axis, channel in channels.items() if channel.every > 1}


def test_truth_gets_full_marks_and_seeing_nothing_none(flown):
    """An answer equal to the label is right; one of no gap is so on a healthy vehicle alone."""
    sensors, flights = flown
    labels = [label for _, label in flights]
    true = [judge(str(i), label, perfect(label, VEHICLE), VEHICLE) for i, label in enumerate(labels)]
    assert all(j.right and j.thrusters_right is not False for j in true)
    assert {j.fault for j in true} >= set(FAULTS)
    table = markdown(set_numbers(true, sensors))
    assert "with its number | " in table and "| 0.0% (0/2" in table
    blind = [judge(str(i), label, blind_eye(label), VEHICLE) for i, label in enumerate(labels)]
    assert all(j.right_class == (j.fault is None) for j in blind)
    assert all(markdown(table) for table in set_tables(blind, sensors))


def test_what_no_log_shows_must_be_said():
    """A depth bias without a mark is told by saying so, and not where something else is named beside."""
    ((_, label),) = fly([draw_cases(1, {"depth_bias": 1.0}, 3, "stock")[0]], VEHICLE, seed=0)
    answer = blind_eye(label)
    assert not judge("a", label, answer, VEHICLE).right_class
    answer["diagnosis"]["cannot_tell"] = [f"depth_bias{NO_MARK}", f"heading_bias{NO_MARK}"]
    judged = judge("a", label, answer, VEHICLE)
    assert (judged.right, judged.right_class, judged.unseen) == (False, True, ("depth_bias", "heading_bias"))
    answer["diagnosis"]["effects"] = [{"name": "buoyancy", "probability": 1.0, "parameters": {}, "thrusters": []}]
    assert not judge("a", label, answer, VEHICLE).right_class


def test_each_set_has_markers_of_its_own(tmp_path, monkeypatch):
    """Publishing one set leaves what stands between the markers of the others."""

    def markers(name):
        return published.SECTIONS["diagnosis.md", section(name)].marks

    monkeypatch.setattr(published.provenance, "age", lambda commit, paths: 0)
    document = tmp_path / "diagnosis.md"
    document.write_text("\n".join("\n".join(markers(name)) for name in (None, *SENSOR_SETS)))
    for name in ("stock", "dvl"):
        publish(f"of {name}", tmp_path, document, name, "make blind", "0123abc")
    text = document.read_text()
    for name in (None, "mocap"):
        assert "\n".join(markers(name)) in text
    first, last = markers("stock")
    assert "of stock" in text.partition(first)[2].partition(last)[0]
