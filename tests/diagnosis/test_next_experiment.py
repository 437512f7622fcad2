"""What a log cannot tell apart is declared, and the next experiment tells it apart."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.identify.equivalence import alternatives, indistinguishable
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.next_experiment import choose_experiment, explore, manoeuvres
from auv_torchrl.diagnosis.verdict import Verdict, Where
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
SETTINGS = load_settings()


@pytest.fixture(scope="module")
def responded():
    """A problem with the marks of all changes on a short log."""
    log = fly(hold(PAPER), {}, seed=2, episodes=2, seconds=12.0)
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), hold(PAPER), SETTINGS)
    problem, follow = follow_windows(problem)
    return problem, Field.of(problem, follow), follow


def found(responded, *terms) -> Any:
    """As much of a search's outcome as is looked at: one explanation without rivals."""
    _, field, follow = responded
    fit = SimpleNamespace(explanation=Explanation(terms), evidence=0.0, chi2=100.0)
    return SimpleNamespace(best=fit, fits=[fit], field=field, follow=follow)


def test_vertical_thrusters_with_one_command_are_told_apart_by_a_pulse(responded):
    """A weak thruster 5 could be a weak 6 where both get the same command; turning about the long axis tells."""
    problem = responded[0]
    weak = found(responded, Term("thruster_gain", ("gain_5",), 0.4))
    assert ("gain_5", "gain_6") in indistinguishable(problem, weak)
    (mine, theirs, other), *_ = [a for a in alternatives(problem, weak) if "gain_6" in a[1]]
    assert (mine, theirs) == ("gain_5", "gain_6")
    assert other.values(problem.vehicle)["thruster_gain"] == {"gain_6": pytest.approx(0.4, abs=0.02)}
    plan = choose_experiment(problem, weak, Verdict.EXPLAINED, Where())
    assert plan is not None
    assert "thruster" in plan.why and "tells “gain 5” and “gain 6” apart" in plan.why


def test_explanations_of_several_effects_or_none_can_be_told_apart_by_eye(responded):
    """The names of two explanations are quoted, and effects that act together are joined by a plus."""
    both = found(responded, Term("battery_sag", ("rate",), 0.4), Term("thruster_gain", ("gain_5",), 0.4))
    both.fits.append(SimpleNamespace(explanation=Explanation(()), evidence=-1.0))
    plan = choose_experiment(responded[0], both, Verdict.EXPLAINED, Where())
    assert plan is not None
    assert "tells “battery sag + thruster gain” and “no effect” apart, by" in plan.why


def test_a_swap_names_no_other_swap_that_merely_shares_a_thruster(responded):
    """Commands 2 and 3 exchanged look like no other exchange, unless the heading were turned round by half a turn."""
    problem = responded[0]
    terms = [Term("thruster_swap", (f"command_{i}",), j, discrete=True) for i, j in ((2, 3.0), (3, 2.0))]
    turned = ("heading_bias with thruster_swap 1 4", "thruster_swap 2 3")
    assert indistinguishable(problem, found(responded, *terms)) == (turned,)
    assert choose_experiment(problem, found(responded, *terms), Verdict.EXPLAINED, Where()) is None


def test_a_thruster_that_gives_what_it_likes_is_run_alone_not_told_from_what_was_dropped(responded):
    """Beside an explanation that fitted better and was dropped, the thruster that was located is what is in doubt."""
    nothing = found(responded)
    nothing.fits.append(SimpleNamespace(explanation=Explanation((Term("drift", ("x",), 1.0),)), evidence=500.0))
    for thruster in (1, 4, 6):
        plan = choose_experiment(responded[0], nothing, Verdict.UNEXPLAINED, Where(thruster={str(thruster): 1.0}))
        assert plan is not None and plan.why.startswith(f"a series of rising pulses of thruster {thruster} alone")
        assert f"run thruster {thruster} for 1.5 s forwards and 1.5 s backwards, at 20" in plan.by_hand
    assert choose_experiment(responded[0], nothing, Verdict.EXPLAINED, Where()) is None


@pytest.mark.parametrize(
    ("where", "plan"),
    [
        (Where(dof={"heave": 0.7, "yaw": 0.3}), "steps of heave"),
        (Where(dof={"surge": 1.0}, thruster={"1": 0.9, "2": 0.1}), "pulse thruster 1"),
    ],
)
def test_an_unexplained_gap_is_looked_at_alone(where, plan):
    """The suspected thruster is pulsed, else the degree of freedom with the largest gap is stepped."""
    planned = explore(PAPER, where)
    assert planned is not None and planned.why.startswith(plan) and planned.thruster_commands is not None
    assert np.abs(planned.thruster_commands).max() <= 1


def test_nothing_is_planned_without_a_lead():
    """Without any share there is nothing to look at."""
    assert explore(PAPER, Where()) is None


def test_every_manoeuvre_is_said_for_a_pilot():
    """Each has sticks or a motor test in words, with sizes and seconds, and no name of the program."""
    told = {name: plan.by_hand.replace("\u202f", " ") for name, plan in manoeuvres(PAPER).items()}
    assert all(" s" in text and "_" not in text for text in told.values()) and len(set(told.values())) == len(told)
    steps, pulse = told["steps of yaw at two sizes"], told["pulse thruster 3 alone"]
    assert steps.startswith("push the stick to turn right and left, 3 s each way at 8 %, then 3 s each way at 16 %")
    assert "motor test" in pulse and "thruster 3 at 40 %" in pulse


def test_manoeuvres_are_gentle_and_come_to_an_end():
    """All commands are within half of the full one, and no manoeuvre is longer than 15 s."""
    for name, (commands, _) in manoeuvres(PAPER).items():
        assert np.abs(commands).max() <= 0.5, name
        assert len(commands) * 0.05 <= 15.0
