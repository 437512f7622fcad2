"""The trial through the firmware: what is drawn, what is done about an answer, and what is counted; no firmware."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from auv_torchrl.effects.advice import Advice
from auv_torchrl.fly.known import MANUAL
from auv_torchrl.link.plant import Plant, Start
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import load_vehicle
from benchmarks.trial import firmware, page, work
from benchmarks.trial.cases import FRAMES, KINDS, Case, Wired, built, draw_cases, of_the_day
from benchmarks.trial.control import Watcher
from benchmarks.trial.dive import MODES, draw_sticks
from benchmarks.trial.motor_detection import Detected, read_texts
from benchmarks.trial.once import read_parameters, read_setting
from benchmarks.trial.remedy import Remedy, mended, remedy_of, still_mirrored

CASES = draw_cases(96, 0)


def test_cases_are_one_of_each_kind_again_and_again():
    """On both frames, the same from the same seed, others from another one."""
    for turn in range(8):
        assert tuple(case.kind for case in CASES[12 * turn : 12 * turn + 12]) == KINDS
    assert {(case.kind, case.frame) for case in CASES} == {(kind, frame) for kind in KINDS for frame in FRAMES}
    assert CASES[:20] == draw_cases(20, 0) != draw_cases(20, 1)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("kind", ["reversed", "dead", "weak", "one_way", "direction"])
def test_thrusters_have_their_turn(kind, frame):
    """Cases of a kind on a frame are of other thrusters until each was at fault."""
    hit = [
        set(next(iter(case.truth.values()))) for case in draw_cases(200, 0) if (case.kind, case.frame) == (kind, frame)
    ]
    count = load_vehicle(FRAMES[frame]).thrusters
    assert len(hit) >= count and len(set.union(*hit[:count])) == count


@pytest.mark.parametrize("case", CASES[:24], ids=lambda case: case.name)
def test_what_is_wrong_is_what_a_diagnosis_should_name(case):
    """Scenarios that the simulator takes; a truth for each but the healthy ones."""
    vehicle = of_the_day(built(case.frame, 0), 0, case.frame, case.number)
    if case.effects:
        scenario = read_scenario("case", {"effects": case.effects}, vehicle)
        read = {change.effect.name: change.values for change in scenario.changes}
        assert read.keys() == case.truth.keys()
        for effect, values in case.truth.items():
            assert values.items() <= read[effect].items()
    assert bool(case.truth) == (case.kind != "healthy")


def test_the_vehicle_that_flies_is_not_that_of_the_file():
    """By some per cent, the same in each dive but for trim and water."""
    stated, flown = load_vehicle("bluerov2"), built(1, 0)
    share = flown.quadratic_drag / stated.quadratic_drag
    assert 0.7 < share.min() < share.max() < 1.3 and (share[[0, 1, 2, 5]] != 1).all()
    one, other = (of_the_day(flown, 0, 1, dive) for dive in (1, 2))
    assert one.vertical_force != other.vertical_force and (one.quadratic_drag == other.quadratic_drag).all()


def test_exchanged_wires_turn_the_whole_curve():
    """Ahead at full thrust such a thruster gives what it gives backwards."""
    vehicle = load_vehicle("bluerov2_heavy")
    wired, plain = Wired((1,), vehicle, Scenario("a"), Start()), Plant(vehicle, Scenario("b"), Start())
    wired.step([1.0, 1.0, *[0.0] * 6], 1 / 400)
    plain.step([-1.0, 1.0, *[0.0] * 6], 1 / 400)
    assert (wired.moment.thrust == plain.moment.thrust).all() and wired.moment.thrust[0, 0] < -35


def test_a_pilot_tries_all_modes_and_axes():
    """Each mode for the same time, and no stick further than the frame bears."""
    sticks = draw_sticks(np.random.default_rng(0), 90.0, 1)
    assert {sticks.mode_at(t) for t in (1.0, 31.0, 61.0)} == set(MODES)
    moved = np.array([sticks.at(t) for t in np.arange(0.0, 90.0, 0.1)])
    assert (np.abs(moved).max(axis=0) > 0.1).all() and np.abs(moved).max() <= 0.28
    begun = 30.0 * sticks.modes.index(MANUAL)
    assert np.abs([sticks.at(t) for t in np.arange(begun, begun + 29.0, 0.1)]).max() <= 0.12


def found(name, values, probability=0.9, param=None, calibrates=False):
    """An effect of an answer."""
    own = {member: SimpleNamespace(value=value, is_nominal=False) for member, value in values.items()}
    advice = (Advice("do it", param or {}),)
    return SimpleNamespace(name=name, parameters=own, is_likely=probability > 0.5, calibrates=calibrates, advice=advice)


def answer(*effects) -> Any:
    """An answer with these effects."""
    return SimpleNamespace(effects=effects, findings=())


def test_an_owner_sets_what_is_to_be_set_and_repairs_what_is_named():
    """Only what is likely, and nothing that corrects the vehicle's file."""
    remedy = remedy_of(
        answer(
            found("thruster_gain", {"gain_1": -1.0}, param={"MOT_1_DIRECTION": -1.0}),
            found("command_delay", {"delay": 0.2}),
            found("current", {"north": 0.2}, probability=0.4),
            found("linear_drag", {"scale_surge": 1.2}, calibrates=True),
            found("buoyancy", {"force": 5.04}),
        )
    )
    assert remedy == Remedy({"MOT_1_DIRECTION": -1.0}, (("command_delay", "delay"),), {"buoyancy": {"force": -5.0}})


def test_a_repair_mends_what_it_names_alone():
    """Trim is taken off by what is said, not by what there is; a part that was good stays as it is."""
    effects = {"buoyancy": {"force": 5.5}, "thruster_gain": {"gain_1": 0.0, "gain_2": 0.5}}
    remedy = Remedy({}, (("thruster_gain", "gain_1"), ("thruster_gain", "gain_4")), {"buoyancy": {"force": -5.0}})
    assert mended(effects, remedy) == {"buoyancy": {"force": 0.5}, "thruster_gain": {"gain_2": 0.5}}
    plugs = {"thruster_swap": {"pair": [1, 2]}}
    assert mended(plugs, Remedy({}, (("thruster_swap", "command_1"),), {})) == {}
    assert mended(plugs, Remedy({"SERVO1_FUNCTION": 34.0}, (), {})) == plugs


def test_wires_stay_exchanged_unless_their_thruster_is_repaired():
    """A parameter of the firmware does not touch them."""
    assert still_mirrored((3,), Remedy({"MOT_3_DIRECTION": -1.0}, (), {})) == [3]
    assert still_mirrored((3,), Remedy({}, (("thruster_gain", "gain_3"),), {})) == []


def test_what_motor_detection_says_is_read():
    """Its texts of 4.7, and whether that is what is wrong."""
    texts = [
        "Thruster 1 is ok!",
        "Thruster 2 is reversed! Saving it!",
        "Failed! Please check Thruster 3 and frame setup!",
    ]
    said = read_texts(texts)
    assert said == Detected((1,), (2,), (3,)) and said.said == "ok 1; reversed 2; failed 3"
    reversed_two = next(case for case in CASES if case.kind == "reversed")
    reversed_two = replace(reversed_two, truth={"thruster_gain": {"gain_2": -1.0}})
    assert read_texts(texts[:2]).names(reversed_two) and not said.names(reversed_two)


def result(verdict="explained", named="", score="RIGHT", repeated=None, detected="ok 1"):
    """What is kept of a case."""
    again = None if repeated is None else {"verdict": repeated[0], "named": repeated[1]}
    return {
        "flown": {"refused": None, "simulated_s": 160.0, "cpu_s": 10.0},
        "diagnosed": {"verdict": verdict, "named": named, "score": score, "cpu_s": 30.0, "remedy": {"said": "did"}},
        "repeated": again,
        "detected": {"said": detected, "names": False},
    }


def test_what_is_counted_is_what_the_rows_say():
    """Named, half named, false alarms, cured; what nobody can cure is not counted against a cure."""
    by_kind = {case.kind: case for case in CASES[:12]}
    results = [
        (by_kind["healthy"], result("explained", "current (p 0.9)", "WRONG", detected="failed 2")),
        (by_kind["reversed"], result(repeated=("no_gap", ""))),
        (by_kind["dead"], result(score="HALF", repeated=("explained", "linear_drag scale_heave 1.3 (p 0.9)"))),
        (by_kind["weak"], result(score="WRONG", repeated=("explained", "thruster_gain gain_1 0.5 (p 0.9)"))),
        (by_kind["current"], result()),
    ]
    text = "\n".join(page.lines(results, 48))
    assert "5 of 48 drawn cases" in text and "named right: 2 of 4, half right: 1" in text
    assert "False alarms on healthy vehicles: 1 of 1" in text
    assert "Cured by the advice: 1 of 3 that an owner can cure; in 1 more" in text
    assert "calls 1 of 1 healthy ones faulty" in text and "at 16 x real time" in text
    assert len(page.row(*results[0])) == len(page.HEAD)


def test_a_case_goes_on_where_it_was_left(tmp_path, monkeypatch):
    """What is kept is not flown again, and a dive that was not flown is not diagnosed."""
    flown = []

    def fly(dive, folder, log_path, seed):
        flown.append((dive, log_path.name))
        return {"refused": "no position", "simulated_s": 1.0, "cpu_s": 0.1}

    monkeypatch.setattr(work, "fly", fly)
    monkeypatch.setattr(work, "detected", lambda case, folder, seed: {"said": "nothing", "names": False, "texts": []})
    monkeypatch.setattr(work, "healthy_dives", lambda frame, folder, seed: [])
    case = next(case for case in CASES if case.kind == "plugs")
    with ThreadPoolExecutor(1) as aside:
        first = work.run(case, tmp_path, 0, aside)
        assert work.run(case, tmp_path, 0, aside) == first
    assert [name for _, name in flown] == ["dive.BIN"] and first["diagnosed"]["verdict"] == "not flown"
    assert work.is_done(case, tmp_path)
    assert json.loads((tmp_path / case.name / "result.json").read_text()) == first


def test_how_far_a_vehicle_is_counts_from_where_the_flight_began():
    """Not from where it was placed."""
    watcher, plant = Watcher(), Plant(load_vehicle("bluerov2_heavy"), Scenario("a"), Start(down=3.0))
    for _ in range(100):
        plant.step([*[0.0] * 4, *[1.0] * 4], 0.01)
        watcher.flown((), plant.moment)
    first, last = watcher.distances(0.5)[0], watcher.distances(0.5)[-1]
    assert first == pytest.approx((0.0, 0.0), abs=0.011) and last[0] == pytest.approx(0.5, abs=0.02)
    gone = watcher.path[-1][1][2] - 3.0
    assert gone > 0.05 and 0.0 < last[1] < gone


def test_settings_are_read_from_a_line_and_from_a_file(tmp_path):
    """``NAME=VALUE``, and what a diagnosis writes."""
    assert read_setting("MOT_1_DIRECTION=-1") == ("MOT_1_DIRECTION", -1.0)
    (tmp_path / "advice.param").write_text("MOT_1_DIRECTION,1\nSERVO2_FUNCTION,34\n")
    assert read_parameters(tmp_path / "advice.param") == {"MOT_1_DIRECTION": 1.0, "SERVO2_FUNCTION": 34.0}
    (tmp_path / "empty.param").write_text("MOT_1_DIRECTION 1\n")
    with pytest.raises(ValueError, match=r"give the advice\.param"):
        read_parameters(tmp_path / "empty.param")


def test_without_the_firmware_its_variable_is_named(monkeypatch, tmp_path):
    """For what is no file as well."""
    monkeypatch.setenv(firmware.VARIABLE, str(tmp_path / "ardusub"))
    with pytest.raises(ValueError, match="ARDUSUB is .*ardusub"):
        firmware.program()


def test_frames_are_the_vehicles_of_the_trial():
    """A case knows its file."""
    assert Case(1, "healthy", 2).vehicle == "bluerov2_heavy" and Case(1, "healthy", 1).name == "01_healthy"
