"""The verdict in one sentence."""

from dataclasses import replace

import pytest

from auv_torchrl.diagnosis.conclude.summary import NO_FAULT, SOUND, summarise
from auv_torchrl.diagnosis.verdict import Verdict, Where
from tests.diagnosis.example import example

FOUND = example()
HEAVE = Where(dof={"heave": 0.7, "yaw": 0.3}, origin={"actuation": 0.8}, thruster={"4": 0.1, "5": 0.45, "6": 0.45})


def test_an_explained_gap_says_what_is_gained():
    """What was found and the share that is gone."""
    said = summarise(Verdict.EXPLAINED, FOUND.effects, FOUND.where, FOUND.gap)
    assert (
        said == "Thruster 4 gives 0.55 times its nominal thrust; with that in the simulator, 97 % of the gap is gone."
    )


def test_an_unexplained_gap_says_where_to_look():
    """The degree of freedom and the thrusters it goes with, but no effect."""
    said = summarise(Verdict.UNEXPLAINED, (), HEAVE, FOUND.gap)
    for words in ("mostly in heave", "commands of thrusters 5 and 6", "no known effect explains it"):
        assert words in said


def test_a_part_explained_says_that_something_else_acts():
    """What was found, its share, and that there is more."""
    said = summarise(Verdict.PARTLY_EXPLAINED, FOUND.effects, HEAVE, replace(FOUND.gap, closed=0.6))
    assert "that explains 60 % of the gap, and something unknown acts too, mostly in heave" in said


@pytest.mark.parametrize("verdict", (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED))
@pytest.mark.parametrize(("probability", "word"), [(0.97, ""), (0.7, "probably (70 %) "), (0.5, "perhaps (50 %) ")])
def test_an_effect_is_told_as_sure_as_it_is(verdict, probability, word):
    """As a fact, probably or perhaps; and where nothing is likely, an unknown effect stands first."""
    effect = replace(FOUND.effects[0], probability=probability)
    said = summarise(verdict, (effect,), HEAVE, FOUND.gap)
    clause = f"{word}thruster 4 gives 0.55 times"
    assert clause.lower() in said.lower()
    assert said.startswith("Something unknown acts") is (verdict is Verdict.PARTLY_EXPLAINED and not effect.is_likely)


def test_what_is_likely_is_told_before_what_is_not():
    """Of several effects each has its word, the likely ones first, and the share is that of all of them."""
    gain = FOUND.effects[0]
    other = replace(gain, name="payload", probability=0.4, sentence="it carries 5 N; it carries that 0.3 m ahead")
    said = summarise(Verdict.PARTLY_EXPLAINED, (other, gain), HEAVE, FOUND.gap)
    assert said.startswith("Thruster 4 gives 0.55")
    assert "; perhaps (40 %) it carries 5 N and it carries that 0.3 m ahead; together that explains 97 %" in said


@pytest.mark.parametrize(("factor", "sentence"), [(1.2, SOUND), (5.0, NO_FAULT)])
def test_no_gap_is_told_from_slack(factor, sentence):
    """A vehicle within the floor is predicted; one beyond it, without an effect, has the slack that all have."""
    position = FOUND.gap.position_m
    assert position is not None
    position = replace(position, before=tuple(factor * f for f in position.floor))
    gap = replace(FOUND.gap, position_m=position, yaw_rad=None, closed=None)
    assert summarise(Verdict.NO_GAP, (), Where(), gap) == sentence


@pytest.mark.parametrize(
    ("factor", "begins"), [(1.2, "No gap in heave, yaw: the"), (5.0, "No fault in heave, yaw: this")]
)
def test_no_gap_is_claimed_of_what_was_examined_alone(factor, begins):
    """Where a vehicle moves in more than the log measures, the sentence names what it measures."""
    position = FOUND.gap.position_m
    assert position is not None
    position = replace(position, before=tuple(factor * f for f in position.floor))
    gap = replace(FOUND.gap, position_m=position, yaw_rad=None, closed=None)
    assert summarise(Verdict.NO_GAP, (), Where(), gap, examined=("heave", "yaw")).startswith(begins)


@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_is_a_sentence(verdict):
    """With as little as there may be to say, a sentence with a capital and one full stop comes out."""
    gap = replace(FOUND.gap, position_m=None, yaw_rad=None, closed=None)
    calibrating = tuple(replace(effect, calibrates=True) for effect in FOUND.effects)
    effects = () if verdict in (Verdict.NO_GAP, Verdict.UNEXPLAINED) else calibrating
    said = summarise(verdict, effects, Where(), gap)
    assert said[0].isupper() and said.endswith(".") and not said.endswith("..")
