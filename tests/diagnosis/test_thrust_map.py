"""What a thruster gives at each command is measured and said; one that changes by itself has no map."""

import pytest
from test_moments import HEAVY, SETTINGS, flown

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.explanation import Explanation, Term
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.localize.unlike import measure_map, unlike_thruster
from auv_torchrl.diagnosis.localize.wording import map_in_words, seen_to_do
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.report.wording import to_do
from auv_torchrl.diagnosis.verdict import Slice, ThrustMap, Where


def unlike(act, seed=2):
    """The thruster that pushes otherwise than commanded along the measured motion of one flight."""
    windows = cut_windows(flown(act, seed=seed)[0], SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    return unlike_thruster(*follow_windows(Problem.of(windows, HEAVY, SETTINGS)))


@pytest.mark.parametrize(
    ("act", "said"),
    [
        ("stalling", "thruster 8 gives nothing above 50 % of its command"),
        ("one_way", "thruster 8 gives nothing forwards"),
        pytest.param(
            "creeping", "thruster 8 pushes forwards with 7 % of its full thrust at rest", marks=pytest.mark.thorough
        ),
        ("stuck", "thruster 8 pushes backwards with 16 % of its thrust, whatever is commanded"),
    ],
)
def test_what_a_thruster_does_at_each_command_is_said_from_its_map(act, said):
    """No effect is asked: a stalling thruster is none of the library, and is said likewise."""
    found = unlike(act)
    assert found is not None and found.thrust_map is not None and found.intermittence is None
    assert map_in_words(found.thrust_map).replace("\u202f", " ") == said


@pytest.mark.parametrize(
    "term", [Term("thruster_gain", ("gain_8",), 0.1), Term("thrust_limit", ("limit_8",), 0.0)], ids=lambda t: t.effect
)
def test_a_map_is_in_shares_of_the_nominal_thrust_whatever_was_found_before(term):
    """Along the motion of a vehicle whose thruster gives a tenth, or nothing, it is the same map."""
    windows = cut_windows(flown("stalling", seed=2)[0], SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s)
    maps = []
    for explanation in (Explanation(), Explanation((term,))):
        mapped = measure_map(*follow_windows(Problem.of(windows, HEAVY, SETTINGS), explanation), 8)
        assert mapped is not None
        maps.append([(one.share, one.most - one.share) for one in mapped.measured.slices])
    for (share, half), (other, _) in zip(*maps, strict=True):
        assert other == pytest.approx(share, abs=0.1 + half)


@pytest.mark.parametrize("act", ["comes_and_goes", pytest.param("wandering", marks=pytest.mark.thorough)])
def test_a_thruster_that_changes_by_itself_has_no_map(act):
    """At one command it gives now more and now less."""
    found = unlike(act)
    assert found is not None and found.thrust_map is None


@pytest.mark.thorough
def test_a_stalling_thruster_is_said_in_words_with_what_to_look_at():
    """In headline, summary and advice, and nothing sound is named beside it."""
    log, label = flown("stalling", slack=0.03)
    diagnosis, thruster = diagnose(log, HEAVY), label["drawn"]["thruster"]
    assert diagnosis.verdict is Verdict.UNEXPLAINED and not diagnosis.effects
    assert diagnosis.headline.startswith(f"Thruster {thruster} gives nothing above")
    assert "speed controller with that of a neighbour" in to_do(diagnosis)[0] and diagnosis.next_experiment is not None
    assert diagnosis.next_experiment.why.startswith(f"a series of rising pulses of thruster {thruster} alone")


def test_slices_that_nothing_is_known_of_are_not_told():
    """A share with a wide interval says nothing; a map without known departures says that no command tells."""
    slices = (Slice(-0.2, -0.1, 0.0, -2.0, 2.0), Slice(0.1, 0.2, 1.0, 0.95, 1.05), Slice(0.2, 0.3, 1.02, 0.98, 1.06))
    where = Where(thrust_map=ThrustMap(3, slices, 0.0, -0.01, 0.01))
    assert seen_to_do(where) == "thruster 3 pushes otherwise than commanded"
    assert seen_to_do(Where()) == ""
