"""One rule says when an answer is right, half right or wrong."""

import pytest

from auv_torchrl.diagnosis.verdict import Diagnosis, EffectProbability, Estimate, FoundEffect, Gap, Verdict, Where
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.scores.judge import judge
from benchmarks.real import ardusub
from benchmarks.scoring import Score, Truth, fault, score_diagnosis, sound, unknown

VEHICLE = load_vehicle("bluerov2_heavy")
DEAD_4 = {"thruster_gain": {"gain_4": 0.0}}
NO_GAP, EXPLAINED, PARTLY = "no_gap", "explained", "partly_explained"


def gain(thruster=4, value=0.01, probability=1.0, **more):
    """A thruster that gives another thrust."""
    parameters = {f"gain_{thruster}": {"value": value, "nominal": 1.0}}
    return {
        "name": "thruster_gain", "probability": probability, "parameters": parameters, "thrusters": [thruster], **more,
    }  # fmt: skip


def drag(probability=1.0, **more):
    """A drag that is not there."""
    parameters = {"scale_yaw": {"value": 1.4, "nominal": 1.0}}
    return {"name": "linear_drag", "probability": probability, "parameters": parameters, "thrusters": [], **more}


def answer(verdict, *effects, alike=(), onset_s=None):
    return {"verdict": verdict, "effects": list(effects), "indistinguishable": alike, "where": {"onset_s": onset_s}}


SAID = {
    "the fault": (fault(DEAD_4), answer(EXPLAINED, gain()), Score.RIGHT),
    "beside what corrects the file": (fault(DEAD_4), answer(EXPLAINED, gain(), drag(calibrates=True)), Score.RIGHT),
    "beside what is not likely": (fault(DEAD_4), answer(EXPLAINED, gain(), drag(0.4)), Score.RIGHT),
    "beside what is not there": (fault(DEAD_4), answer(EXPLAINED, gain(), drag()), Score.HALF),
    "partly explained": (fault(DEAD_4), answer(PARTLY, gain()), Score.HALF),
    "perhaps": (fault(DEAD_4), answer(PARTLY, gain(probability=0.4)), Score.HALF),
    "another value": (fault(DEAD_4), answer(EXPLAINED, gain(value=0.3)), Score.HALF),
    "late": (fault(DEAD_4), answer(EXPLAINED, gain(), onset_s=50.0), Score.HALF),
    "as late as it is": (fault(DEAD_4, 51.0), answer(EXPLAINED, gain(), onset_s=50.0), Score.RIGHT),
    "another thruster": (fault(DEAD_4), answer(EXPLAINED, gain(3)), Score.WRONG),
    "another thruster, declared": (
        fault(DEAD_4), answer(EXPLAINED, gain(3), alike=[["thruster_gain 3", "thruster_gain 4"]]), Score.HALF),
    "another effect": (fault(DEAD_4), answer(EXPLAINED, drag()), Score.WRONG),
    "another effect, declared": (
        fault(DEAD_4), answer(EXPLAINED, drag(), alike=[["linear_drag", "thruster_gain 4"]]), Score.HALF),
    "nothing": (fault(DEAD_4), answer(NO_GAP), Score.WRONG),
    "one of two": (fault({**DEAD_4, "current": {"north": 0.1}}), answer(EXPLAINED, gain()), Score.WRONG),
    "a sound vehicle": (sound(), answer(NO_GAP), Score.RIGHT),
    "a sound vehicle, called faulty": (sound(), answer(EXPLAINED, gain()), Score.WRONG),
    "a sound vehicle, called odd": (sound(), answer("unexplained"), Score.WRONG),
    "what the library lacks": (unknown(), answer("unexplained"), Score.RIGHT),
    "what the library lacks, perhaps": (unknown(), answer(PARTLY, gain(probability=0.4)), Score.RIGHT),
    "what the library lacks, by a name": (unknown(), answer(PARTLY, gain()), Score.HALF),
    "what the library lacks, explained": (unknown(), answer(EXPLAINED, gain()), Score.WRONG),
}  # fmt: skip


@pytest.mark.parametrize("said", SAID)
def test_an_answer_is_scored_by_verdict_names_values_and_moment(said):
    """Right needs all of them; half right has the cause on its thruster; all else is wrong."""
    truth, given, expected = SAID[said]
    assert score_diagnosis(given, truth, VEHICLE) is expected


@pytest.mark.parametrize(
    ("truth", "found", "expected"),
    [
        ({"north": 0.15, "east": -0.10}, {"north": 0.17, "east": -0.09}, Score.RIGHT),
        ({"north": 0.15, "east": -0.10}, {"north": 0.15, "east": -0.06}, Score.HALF),
        ({"north": 0.15, "east": 0.001}, {"north": 0.15, "east": 0.01}, Score.RIGHT),
        ({"north": 0.15, "east": 0.001}, {"north": 0.15, "east": 0.03}, Score.HALF),
    ],
)
def test_a_value_is_near_by_its_own_size_or_half_the_largest_of_its_unit(truth, found, expected):
    """A fifth of what a number departs by; one that hardly departs is held to half of what its neighbour does."""
    parameters = {name: {"value": value, "nominal": 0.0} for name, value in found.items()}
    effect = {"name": "current", "probability": 1.0, "parameters": parameters, "thrusters": []}
    assert score_diagnosis(answer(EXPLAINED, effect), fault({"current": truth}), VEHICLE) is expected


def test_a_plug_is_the_very_one():
    """Plugs 1 and 7 exchanged are not 1 and 6, though 6 is near to 7."""
    truth = {"command_1": 6.0, "command_6": 1.0}
    parameters = {"command_1": {"value": 7.0, "nominal": 1.0}, "command_6": {"value": 1.0, "nominal": 6.0}}
    effect = {"name": "thruster_swap", "probability": 1.0, "parameters": parameters, "thrusters": [1, 6]}
    assert score_diagnosis(answer(EXPLAINED, effect), fault({"thruster_swap": truth}), VEHICLE) is Score.HALF


def test_half_a_certainty_is_no_right_row_of_the_firmware_table():
    """Thruster 4 as perhaps 40 % in a gap that is partly explained is half right, and its row says the probability."""
    case = next(case for case in ardusub.CASES if case.name == "stock_dead_thruster4")
    estimate = {"gain_4": Estimate(0.0, -0.1, 0.1, 1.0, "1")}
    effect = FoundEffect("thruster_gain", 0.4, estimate, (4,), 0.9, "Thruster 4 gives no thrust.")
    said = Diagnosis(
        "log", "bluerov2_heavy", Verdict.PARTLY_EXPLAINED, "", Where(), (effect,),
        (EffectProbability("thruster_gain", 0.4),), (), None, Gap(()), None,
    )  # fmt: skip
    result = ardusub.Result(case, said, VEHICLE, 90.0)
    assert result.score is Score.HALF
    line, _, counted = list(ardusub.table([result.row]))[2:]
    assert counted == "0 of 1 right, 1 half right."
    assert "| partly_explained | thruster_gain gain_4 0.00 (p 0.40) |  | no | yes | 90 |" in line


def test_sealed_cases_are_scored_by_the_same_rule():
    """A dead thruster named first, but with a drag that is not there, is first and half right."""
    label = {
        "family": "single", "plant": "mujoco", "truth": "thruster_gain", "effects": ["thruster_gain"], "outside": None,
        "left_out": None, "scale": 1.0, "episodes": 6, "episode_s": 30.0, "noise": 1.0, "onset_s": None,
        "values": DEAD_4, "influence": {"thruster_gain": 100.0},
    }  # fmt: skip
    effects = [{**e, "parameters": {k: {**p, "low": 0.0, "high": 2.0} for k, p in e["parameters"].items()}}
               for e in (gain(), drag())]  # fmt: skip
    given = {"diagnosis": {**answer(EXPLAINED, *effects), "candidates": [], "gap": {}}, "seconds": 1.0, "cpu_s": 1.0}
    judged = judge("case", label, given, VEHICLE)
    assert (judged.right, judged.score) == (True, "half")


def test_a_truth_may_allow_several_verdicts():
    """Whichever of them is given fits."""
    truth = Truth(frozenset((NO_GAP, PARTLY)))
    assert {score_diagnosis(answer(v), truth, VEHICLE) for v in (NO_GAP, PARTLY)} == {Score.RIGHT}


def test_a_propeller_that_turns_the_wrong_way_has_two_names_where_it_pushes_evenly():
    """It gets the opposite of its command, or has a gain of -1; where a thruster pushes harder ahead these differ."""
    reversed_4 = fault({"thruster_gain": {"gain_4": -1.0}})
    swap = {
        "name": "thruster_swap", "probability": 1.0, "parameters": {"command_4": {"value": -4.0, "nominal": 4.0}},
        "thrusters": [4],
    }  # fmt: skip
    assert score_diagnosis(answer(EXPLAINED, swap), reversed_4, ardusub.pushing_evenly(VEHICLE)) is Score.RIGHT
    assert score_diagnosis(answer(EXPLAINED, swap), reversed_4, VEHICLE) is Score.WRONG
    other = {**swap, "parameters": {"command_3": {"value": -3.0, "nominal": 3.0}}, "thrusters": [3]}
    assert score_diagnosis(answer(EXPLAINED, other), reversed_4, ardusub.pushing_evenly(VEHICLE)) is not Score.RIGHT
