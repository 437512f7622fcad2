"""Strangers: vehicles of which the file is wrong are drawn, flown with healthy logs, diagnosed and scored."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.examine import examine, read_answers
from benchmarks.blind.flights.cases import HEALTHY
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.foreign import ForeignPlant
from benchmarks.blind.flights.influence import CLEAR_AT
from benchmarks.blind.flights.mujoco_plant import MujocoPlant
from benchmarks.blind.flights.sizes import CLEAR, draw_values
from benchmarks.blind.flights.strangers import (
    as_flown,
    draw_flight,
    draw_stranger,
    draw_stranger_cases,
    healthy_flights,
    with_changes,
)
from benchmarks.blind.scores.judge import judge
from benchmarks.blind.scores.report import markdown
from benchmarks.blind.scores.score_strangers import stranger_numbers, stranger_tables
from benchmarks.blind.seal import log_path, open_labels, read_manifest, seal
from tests.benchmarks.test_flying import APART, distance, swim
from tests.benchmarks.test_scoring import blind_eye, perfect

VEHICLE = load_vehicle("paper")
SHARES = {"single": 22.0, "pair": 6.0, "no_gap": 6.0, "outside": 6.0}
LEVEL = ("mass_offset", "payload", "coriolis")  # tilt the vehicle, which the foreign simulator holds level


def test_cases_are_the_same_for_a_seed_and_hold_every_effect():
    """Forty cases: each effect alone once, strangers in turn, one simulator each, as the label says."""
    cases = draw_stranger_cases(40, SHARES, 5)
    assert cases == draw_stranger_cases(40, SHARES, 5) != draw_stranger_cases(40, SHARES, 6)
    assert Counter(case.family for case in cases) == SHARES
    assert {case.effects[0] for case in cases if case.family == "single"} == set(CLEAR)
    assert {case.slack for case in cases} == {0.0}
    counts = Counter(case.stranger for case in cases)
    assert set(counts) == set(range(1, 7)) and set(counts.values()) == {6, 7}
    assert len({(case.stranger, case.plant) for case in cases}) == 6
    with pytest.raises(ValueError, match="unknown families"):
        draw_stranger_cases(40, {"onset": 1.0}, 5)


def test_each_stranger_has_healthy_flights_of_its_own():
    """As many as asked for, four episodes of the same vehicle, numbered on, with nothing to be found."""
    cases = draw_stranger_cases(14, SHARES, 5)
    sound = healthy_flights(cases, 2)
    assert [(case.stranger, case.number) for case in sound] == [(1, 15), (1, 16), (2, 17), (2, 18)]
    assert {(case.family, case.truth, case.episodes) for case in sound} == {(HEALTHY, "no_gap", 4)}
    assert all({case.plant for case in cases if case.stranger == own.stranger} == {own.plant} for own in sound)


def test_a_stranger_is_one_vehicle_and_off_by_thirty_per_cent():
    """The same for a seed and a number, another for others; factors are log-normal and gains go together."""
    assert draw_stranger(1, 2, VEHICLE) == draw_stranger(1, 2, VEHICLE)
    assert draw_stranger(1, 2, VEHICLE) != draw_stranger(1, 3, VEHICLE) != draw_stranger(2, 3, VEHICLE)
    many = [draw_stranger(0, number, VEHICLE) for number in range(300)]
    drag = np.log([list(one["quadratic_drag"].values()) for one in many])
    gain = np.log([list(one["thruster_gain"].values()) for one in many])
    assert drag.shape == (300, 4) and abs(drag.std() - 0.3) < 0.02 and abs(np.corrcoef(drag.T)[0, 1]) < 0.2
    assert abs(gain.mean(1).std() - 0.3) < 0.04 and abs((gain - gain.mean(1, keepdims=True)).std() - 0.09) < 0.01
    flights = [draw_flight(np.random.default_rng(number)) for number in range(300)]
    assert abs(np.std([flight["buoyancy"]["force"] for flight in flights]) - 0.5) < 0.06


@pytest.mark.parametrize("number", [1, 2])
def test_the_two_simulators_agree_on_strangers_and_on_what_befalls_them(number):
    """Factors act on what a stranger has and forces on top of it, the same in both codes, for every effect."""
    rng = np.random.default_rng(number)
    own = draw_stranger(0, number, VEHICLE) | {"mass_offset": {}}
    befalls = {effect: draw_values(effect, VEHICLE, rng) for effect in CLEAR if effect not in LEVEL}
    rows = len(befalls) + 1
    plants = MujocoPlant(VEHICLE, rows, CONTROL_DT), ForeignPlant(rows, CONTROL_DT)
    for plant in plants:
        for changes in (own, draw_flight(np.random.default_rng(7))):
            for name, values in changes.items():
                plant.change(slice(0, rows), name, values)
        for row, (name, values) in enumerate(befalls.items()):
            plant.change(slice(row, row + 1), name, values)
    apart = distance(*(swim(plant, seconds=4.0) for plant in plants)).max(axis=0)
    assert {name: far for name, far in zip((*befalls, "none"), apart, strict=True) if far > APART.get(name, 0.03)} == {}


@pytest.fixture(scope="module")
def flown():
    """Short flights of two strangers, and healthy ones of each."""
    cases = draw_stranger_cases(10, {"single": 5.0, "pair": 2.0, "no_gap": 1.0, "outside": 2.0}, 1)
    cases = [replace(case, stranger=case.number % 2 + 1) for case in cases]
    both = [*cases, *healthy_flights(cases, 2)]
    return fly([replace(case, plant="foreign", episodes=2, episode_s=12.0) for case in both], VEHICLE, seed=3)


def test_labels_say_what_was_flown(flown):
    """All flights of a stranger have one vehicle and differ in trim and current; effects show on the stranger."""
    vehicles, trims = {}, set()
    for _, label in flown:
        stranger, flight = label["base"]
        assert vehicles.setdefault(label["stranger"], stranger) == stranger
        trims.add(flight["buoyancy"]["force"])
        assert set(label["values"]) == set(label["effects"])
        assert all(shown >= CLEAR_AT for shown in label["influence"].values())
    assert len(vehicles) == 2 and len(trims) == len(flown)


def test_a_current_adds_to_that_of_its_flight():
    """What a log has of an effect is what befell the vehicle and what this flight has of it, and no more."""
    own, flight = {"buoyancy": {"force": 2.0}}, {"current": {"north": 0.25}, "buoyancy": {"force": 0.5}}
    values = {"current": {"north": 0.5, "east": 0.2}, "thruster_gain": {"gain_1": 0.5}}
    assert as_flown({"values": values, "base": [own, flight]}) == values | {"current": {"north": 0.75, "east": 0.2}}
    assert as_flown({"values": values}) == values


def test_truth_gets_full_marks_and_seeing_nothing_none(flown):
    """What is found counts from the stranger, and an effect too many is a wrong answer."""
    labels = [label for _, label in flown if label["family"] != HEALTHY]
    vehicles = [with_changes(VEHICLE, label["base"]) for label in labels]
    told = [{**label, "values": as_flown(label)} for label in labels]
    given = [perfect(label, vehicle) for label, vehicle in zip(told, vehicles, strict=True)]
    true = [judge(str(i), label, answer, VEHICLE) for i, (label, answer) in enumerate(zip(labels, given, strict=True))]
    assert all(j.right and j.thrusters_right is not False and all(j.covered.values()) for j in true)
    assert all(error < 1e-9 for j in true for error in j.errors.values())
    assert "nothing else | ≥ 85 % | ≥ 95 % | 100.0% (5/5" in markdown(stranger_numbers(true, 2))
    assert markdown(stranger_tables(true, 2)[-1]).endswith("None.")
    beside = {"name": "current", "probability": 0.6, "parameters": {}, "thrusters": []}
    for answer in given:
        answer["diagnosis"]["effects"].append(beside)
    more = [judge(str(i), label, answer, VEHICLE) for i, (label, answer) in enumerate(zip(labels, given, strict=True))]
    text = markdown(stranger_numbers(more, 2))
    assert "nothing else | ≥ 85 % | ≥ 95 % | 0.0% (0/5" in text and "whatever else is named |  |  | 100.0% (5/5" in text
    blind = [judge(str(i), label, blind_eye(label), VEHICLE) for i, label in enumerate(labels)]
    assert all(j.right == (j.truth == "no_gap") for j in blind)


@pytest.mark.thorough
def test_a_stranger_is_diagnosed_against_its_healthy_flights(tmp_path):
    """A dead thruster is named alone, and a sound flight is none: the file's errors are no fault."""
    cases = draw_stranger_cases(2, {"single": 1.0, "no_gap": 1.0}, 1)
    cases = [replace(case, stranger=1, effects=("thruster_gain",) if case.effects else ()) for case in cases]
    both = [*cases, *healthy_flights(cases, 2)]
    flights = fly([replace(case, plant="foreign", episodes=3, episode_s=20.0) for case in both], VEHICLE, seed=1)
    seal(tmp_path, {}, flights)
    tasks = read_manifest(tmp_path)["tasks"]
    assert {name: task["healthy"] for name, task in tasks.items()} == dict.fromkeys(
        ("case_0001", "case_0002"), ["healthy_0003", "healthy_0004"]
    )
    assert len(read_flightlog(log_path(tmp_path, "healthy_0003"), VEHICLE).episodes) == 3
    examine(tmp_path, tmp_path / "answers", workers=1)
    answers = read_answers(tmp_path, tmp_path / "answers")
    judged = [judge(name, label, answers[name], VEHICLE) for name, label in open_labels(tmp_path).items()]
    assert [j.message for j in judged if j.message] == []
    assert {j.named for j in judged} == {("thruster_gain",), ()}
    assert all(j.thrusters_right is not False for j in judged)
