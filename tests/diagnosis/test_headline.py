"""The headline: what an owner reads at a glance; the alternatives and the things to do below it."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.conclude.findings import to_change
from auv_torchrl.diagnosis.conclude.summary import MOST_WORDS, headline_of
from auv_torchrl.diagnosis.identify.posterior import UNKNOWN
from auv_torchrl.diagnosis.report.wording import SOUND_DIVE, either, rows, sentence, to_do
from auv_torchrl.diagnosis.unanswered.wording import STILL
from auv_torchrl.diagnosis.verdict import FLOOR_ASSUMED, Estimate, FoundEffect, Intermittence, Verdict
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.advice import Advice
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.example import example

PAPER = load_vehicle("paper")
EXAMPLE = example()
STUCK = Finding(Severity.WARNING, STILL, "depth does not answer to any command", "look at it", ("z",))
LOOSE = Intermittence(7, 0.38, 0.3, 0.46)
DOUBT = Finding(Severity.WARNING, "time", "time goes backwards", "", ("t",), limits=True)


@st.composite
def found_effects(draw) -> tuple[FoundEffect, ...]:
    """Some effects of the library with some of their parameters moved, each as sure as drawn."""
    found = []
    for name in draw(st.lists(st.sampled_from(sorted(EFFECTS)), min_size=1, max_size=3, unique=True)):
        effect, declared = EFFECTS[name], EFFECTS[name].member_parameters(PAPER)
        members = draw(st.lists(st.sampled_from(sorted(declared)), min_size=1, max_size=8, unique=True))
        values = {m: draw(st.floats(declared[m].low, declared[m].high)) for m in members}
        values = {m: float(round(v)) if declared[m].discrete else v for m, v in values.items()}
        sentence = "; ".join(declared[m].sentence_of(m, v) for m, v in values.items())
        sentence = effect.sentence(values) if effect.sentence else sentence
        numbers = {int(m.rsplit("_", 1)[1]) for m in members if declared[m].over == "thruster"}
        estimates = {
            m: Estimate(v, v - 0.1, v + 0.1, effect.nominal(PAPER)[m], declared[m].unit) for m, v in values.items()
        }
        sure, corrects = draw(st.floats(0, 1)), draw(st.booleans())
        found.append(FoundEffect(name, sure, estimates, tuple(sorted(numbers)), 0.5, sentence, calibrates=corrects))
    return tuple(found)


@given(
    found_effects(),
    st.sampled_from(list(Verdict)),
    st.sampled_from([(), (STUCK,), (DOUBT,)]),
    st.sampled_from([None, LOOSE]),
)
@settings(max_examples=200, deadline=None)
def test_a_headline_is_read_at_a_glance(effects, verdict, findings, loose):
    """Whatever was found, it is one sentence of at most fifteen words without a name of the program."""
    where = replace(EXAMPLE.where, intermittence=loose)
    headline = headline_of(replace(EXAMPLE, effects=effects, verdict=verdict, findings=findings, where=where))
    assert len(headline.split()) <= MOST_WORDS and headline.endswith(".") and headline[0] == headline[0].upper()
    assert "_" not in headline


MANY = [name for name, effect in EFFECTS.items() if any(p.over == "thruster" for p in effect.parameters)]


@pytest.mark.parametrize("name", MANY)
def test_several_thrusters_of_one_effect_are_a_sentence(name):
    """Of every effect that acts on single thrusters, and of as many as there are."""
    numbers = tuple(range(1, 7))
    several = FoundEffect(name, 1.0, {}, numbers, 0.5, "; ".join(f"thruster {k} does something" for k in numbers))
    headline = headline_of(replace(EXAMPLE, effects=(several,), verdict=Verdict.EXPLAINED, findings=()))
    clause = EFFECTS[name].of_several.format(which="1, 2, 3, 4, 5 and 6")
    assert headline.lower() == f"{clause}.".lower() and len(headline.split()) <= MOST_WORDS


@pytest.mark.parametrize("verdict", [Verdict.UNEXPLAINED, Verdict.PARTLY_EXPLAINED])
def test_a_thruster_that_comes_and_goes_is_said_with_its_share_and_looked_at_first(verdict):
    """A loose plug has no name in the library, and its owner knows all the same where to look."""
    where = replace(EXAMPLE.where, intermittence=LOOSE)
    loose = replace(EXAMPLE, effects=(), verdict=verdict, findings=(), where=where)
    assert headline_of(loose).startswith("Thruster 7 gives nothing for 38\u202f% of the time")
    assert to_do(loose)[0].startswith("Look at plug and wires of thruster 7")


def test_what_does_not_answer_is_the_headline():
    """A sensor that stands still comes before every cause."""
    headline = headline_of(replace(EXAMPLE, verdict=Verdict.CANNOT_TELL, effects=(), findings=(STUCK,)))
    assert headline == "Depth does not answer to any command."


def test_a_log_that_may_as_well_have_a_wrong_file_asks_for_a_sound_dive_first():
    """Where the log is in doubt and corrections of the file are all that was found, one sound dive tells the two."""
    assumed = Finding(Severity.INFO, FLOOR_ASSUMED, "no healthy flight", "")
    file = replace(EXAMPLE.effects[0], calibrates=True, probability=0.5, gap_closed=0.9)
    said = replace(EXAMPLE, verdict=Verdict.PARTLY_EXPLAINED, effects=(file,), findings=(DOUBT, assumed))
    assert headline_of(said) == "The log or the vehicle's file is off; one sound dive would tell which."
    assert to_do(said)[0].startswith("Record one dive on which the vehicle is sound")


def test_what_explains_a_part_only_says_that_more_acts():
    """The cause and the unknown are both in the headline."""
    headline = headline_of(replace(EXAMPLE, verdict=Verdict.PARTLY_EXPLAINED))
    assert headline == "Thruster 4 gives 0.55 times its nominal thrust; something unknown acts too."


@pytest.mark.parametrize("factor", (0.4, 1.0))
def test_alternatives_add_up_to_one_and_agree_with_each_effect(factor):
    """Of the explanations one is true; an effect is as probable as the explanations that have it."""
    scenario = {"thruster_gain": {"gain_3": factor}} if factor < 1 else {}
    diagnosis = diagnose(fly(hold(PAPER), scenario, seed=1, episodes=3, seconds=20.0), PAPER)
    told = either(diagnosis)
    assert np.isclose(sum(told.values()), 1.0) and min(told.values()) >= 0.0
    assert list(told.values()) == sorted(told.values(), reverse=True) or len(told) < 2
    by_effect = {one.name: one.probability for one in diagnosis.candidates}
    having = sum(one.probability for one in diagnosis.alternatives if "thruster_gain" in one.effects)
    assert having == pytest.approx(by_effect["thruster_gain"], abs=0.02)
    assert by_effect[UNKNOWN] < 0.5 and diagnosis.headline.startswith("Thruster 3" if factor < 1 else "No ")


def test_equal_values_of_a_family_are_one_row():
    """Eight thrusters that all give 0.38 take one line; one that differs keeps all."""
    gains = {f"gain_{n}": Estimate(0.38, 0.37 - 0.001 * n, 0.39, 1.0, "1") for n in range(1, 9)}
    effect = replace(EXAMPLE.effects[0], parameters=gains)
    (row,) = rows(effect)
    assert row.name == "gain 1 to 8" and row.estimate.low == pytest.approx(0.362)
    other = replace(effect, parameters=gains | {"gain_8": Estimate(0.9, 0.8, 1.0, 1.0, "1")})
    assert len(rows(other)) == 8


def test_a_repair_comes_first_and_is_as_sure_as_its_cause():
    """What is set and repaired stands before what is flown, and what is perhaps so says it."""
    unsure = replace(EXAMPLE.effects[0], probability=0.4, advice=(Advice("look for weed"),))
    told = to_do(replace(EXAMPLE, effects=(unsure,)))
    assert told[0] == "Perhaps (40 %) look for weed." and told[-1].startswith("Fly next_experiment.csv")
    assert to_change(EXAMPLE) == {"MOT_4_DIRECTION": 1.0}
    assert not to_change(replace(EXAMPLE, effects=(replace(EXAMPLE.effects[0], probability=0.4),)))


def test_a_sound_dive_is_asked_for_where_it_is_missing():
    """Where something unknown acts and no flight of the sound vehicle was given, one is asked for."""
    assumed = Finding(Severity.INFO, FLOOR_ASSUMED, "no healthy log", "Give healthy=LOG")
    partly = replace(EXAMPLE, verdict=Verdict.PARTLY_EXPLAINED, findings=(assumed,))
    assert sentence(SOUND_DIVE) in to_do(partly)
    assert sentence(SOUND_DIVE) not in to_do(replace(partly, verdict=Verdict.EXPLAINED))
    assert sentence(SOUND_DIVE) not in to_do(replace(partly, findings=()))
