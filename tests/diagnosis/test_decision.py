"""How a verdict was reached: the answer says what was compared, what was kept, and why each effect is named or not."""

import json
from types import SimpleNamespace

import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.search import Found
from auv_torchrl.diagnosis.report import decision_table, report_page
from auv_torchrl.diagnosis.verdict import Decision, Hypothesis, from_json, to_json
from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import PROJECT
from auv_torchrl.sysid import Outcome
from auv_torchrl.vehicle import load_vehicle
from tests.hovering import ACTING

PAPER = load_vehicle("paper")
REFERENCE = PROJECT / "docs" / "reference" / "diagnosis-json.md"
TRUTHS = {"a weak thruster": {"thruster_gain": {"gain_4": 0.55}}, "nothing": {}}


@pytest.fixture(scope="module", params=TRUTHS.values(), ids=list(TRUTHS))
def answered(request):
    """What was flown, and the diagnosis of it."""
    return request.param, diagnose(fly(hold(PAPER), request.param, seed=3, episodes=3, seconds=20.0), PAPER)


def test_the_hypothesis_that_is_kept_is_the_answer(answered):
    """Its effects are those that are named, it was simulated, and no other simulated one is more probable."""
    _, diagnosis = answered
    best = diagnosis.decision.best
    assert best is not None and best.simulated
    assert set(best.effects) == {effect.name for effect in diagnosis.effects}
    simulated = [one for one in diagnosis.decision.trace if one.simulated]
    assert all(diagnosis.decision.behind(one) >= 0 for one in simulated)
    assert [one.outcome for one in simulated].count(Outcome.KEPT) == 1


def test_every_effect_of_the_library_has_a_reason(answered):
    """Also those that no log of these sensors shows, and those that are not looked for."""
    flown, diagnosis = answered
    reasons = diagnosis.decision.reasons
    assert reasons.keys() == EFFECTS.keys()
    assert all(reasons.values())
    assert {name for name, why in reasons.items() if why.startswith("kept")} == flown.keys()
    assert "log units behind" in reasons["tether"]
    assert reasons["sensor_noise"] == "not looked for"


def test_no_effect_is_the_beginning_of_every_trace(answered):
    """What is dropped says how it came up."""
    _, diagnosis = answered
    first, *others = diagnosis.decision.trace
    assert first.effects == () and first.simulated
    assert others and all(one.proposed for one in others)


def test_the_decision_survives_its_file(answered):
    """As all else in diagnosis.json; a file that was written before it had one is read, too."""
    _, diagnosis = answered
    content = json.loads(json.dumps(to_json(diagnosis)))
    assert from_json(content).decision == diagnosis.decision
    del content["decision"]
    assert from_json(content).decision.trace == ()


def test_page_and_console_tell_how_it_was_decided(answered):
    """Every hypothesis that was simulated is a row of both; the page has the reasons, too."""
    _, diagnosis = answered
    page, table = report_page(diagnosis, PAPER), decision_table(diagnosis)
    assert 'id="decision"' in page and "How this was decided" in page
    assert page.count(Outcome.KEPT.value) == table.count(Outcome.KEPT.value) == 1
    assert "why each effect is named, or is not" in table
    assert all(name.replace("_", " ") in page for name in ACTING)


def test_what_tells_the_next_best_apart_is_said(answered):
    """Channels of the log with their shares, most first; a sound vehicle may have no rival that was simulated."""
    flown, diagnosis = answered
    decision = diagnosis.decision
    if flown:
        assert diagnosis.verdict is Verdict.EXPLAINED
        assert decision.next_best and decision.apart
    assert list(decision.apart.values()) == sorted(decision.apart.values(), reverse=True)
    assert 0 <= sum(decision.apart.values()) <= 1 + 1e-9


def test_the_reference_tells_every_outcome():
    """By the word that the file has for it."""
    line = next(
        line for line in REFERENCE.read_text(encoding="utf-8").splitlines() if "`decision.trace.outcome`" in line
    )
    assert [outcome.name.lower() for outcome in Outcome if f"`{outcome.name.lower()}`" not in line] == []


def test_no_row_is_ahead_of_the_best_fit_where_it_was_taken_back():
    """An explanation that was fitted from several values is one row, and what is left of all says why it stands."""

    def tried(effects, evidence, outcome):
        return Hypothesis(effects, {}, evidence, 0.0, 1.0, "by a test", outcome)

    trace = (
        tried((), -900.0, Outcome.LEFT),
        tried(("tether",), -200.0, Outcome.REFUTED),
        tried(("tether",), -100.0, Outcome.REFUTED),
        tried(("current",), -50.0, Outcome.PREDICTED),
    )
    decision = Decision(trace)
    assert decision.simulated == (trace[0], trace[2])
    assert [decision.behind(one) for one in decision.simulated] == [800.0, 0.0]


@pytest.mark.parametrize(
    ("effects", "gap", "most"), [(("tether",), 1000.0, 1.15 + 0.4), (("tether",), 1.0, 1.15), ((), 1e6, 1.15)]
)
def test_what_an_explanation_may_leave_grows_with_what_the_fault_does(effects, gap, most):
    """By the square of the share by which its model may be wrong; where no fault is named, by nothing."""
    found = SimpleNamespace(
        excess=1.0,
        best=SimpleNamespace(explanation=SimpleNamespace(effects=effects)),
        problem=SimpleNamespace(settings=SimpleNamespace(excess=1.15)),
        field=SimpleNamespace(
            none=lambda: SimpleNamespace(chi2=50.0 * (gap + 1.0)), quadratic=SimpleNamespace(numbers=50)
        ),
    )
    assert vars(Found)["most_left"].fget(found) == pytest.approx(most, abs=1e-3)
