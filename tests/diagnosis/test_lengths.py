"""A log too short for its settings is refused before anything is computed."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import load_settings, nuisance_parameters
from auv_torchrl.diagnosis.lengths import MOST_S, spread, stretches_of
from auv_torchrl.flightlog import Episode, FlightLog, FlightLogError
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.flightlog.simulate import POSE_ONLY, simulated_logs

PAPER = load_vehicle("paper")
SETTINGS = load_settings()


def flown(seconds, episodes=1):
    return replace(simulated_logs("paper", [{}], episodes, seconds)[0], axes=POSE_ONLY)


@pytest.fixture
def lazy(monkeypatch):
    """A diagnosis that fails where its work begins."""

    def begin(*_, **__):
        raise AssertionError("work began")

    monkeypatch.setattr(sys.modules["auv_torchrl.diagnosis.pipeline"], "explain_log", begin)


@pytest.mark.parametrize(
    ("logs", "changes", "message"),
    [
        ({"log": flown(3.0)}, {}, r"first four fifths .*lead_s=1.5 and diagnosis.window_s=2 \(3.5 s\).*12.6 s or more"),
        ({"log": flown(11.0)}, {}, r"last fifth, held out, .*lead_s=1.5 and 1 s \(2.5 s\).*12.6 s or more, or.*test="),
        ({"log": flown(20.0)}, {"window_s": 30.0}, r"diagnosis.window_s=30 \(31.5 s\), and there are 16.0 s.*39.5 s"),
        ({"log": flown(20.0)}, {"lead_s": 5.0}, r"diagnosis.lead_s=5 and 1 s.*give an episode of 30.1 s"),
        ({"log": flown(2.0, episodes=3)}, {}, "an episode to learn from must hold .*give an episode of 3.5 s or more"),
        ({"log": flown(13.0), "test": [flown(2.0)]}, {}, r"an episode to predict must hold .*2.5 s or more"),
        ({"log": flown(13.0), "healthy": [flown(3.0)]}, {}, r"a healthy log needs .*3.5 s or more"),
    ],
    ids=range(7),
)
def test_what_is_too_short_is_said_with_the_settings_and_the_length_needed(lazy, logs, changes, message):
    """The part that is learnt from, the part held out, the test log and the healthy log."""
    with pytest.raises(FlightLogError, match=f"too short: .*{message}"):
        diagnose(vehicle=PAPER, settings=replace(SETTINGS, **changes), **logs)


def test_a_short_log_in_which_no_thruster_turns_is_no_dive(lazy):
    """Armed for seconds with commands inside the dead band: that is said, and not which settings are too large."""
    (episode,) = (log := flown(8.0)).episodes
    idle = replace(log, episodes=(replace(episode, commands=0.03 * np.sign(episode.commands)),))
    with pytest.raises(FlightLogError, match=r"holds no dive: no thruster turns in it.*12.6 s or more$"):
        diagnose(idle, PAPER, settings=SETTINGS)


def test_the_length_that_is_asked_for_is_enough(lazy):
    """No log as long as the message says is refused."""
    for log in (flown(12.7), flown(3.7, episodes=3)):
        with pytest.raises(AssertionError, match="work began"):
            diagnose(log, PAPER, settings=SETTINGS)


ZEROS = {
    "dead_band": {"dead_band"},
    "linear_drag": {"linear_drag"},
    "quadratic_drag": {"quadratic_drag"},
    "added_mass": set(),  # the rigid body is left
}


def without(name):
    """The paper's vehicle with that coefficient 0, as its file allows."""
    content = dict(read_vehicle_file("paper"))
    if name in content:
        return load_vehicle({**content, name: [0.0] * 6})
    return load_vehicle({**content, "thrusters": {**content["thrusters"], name: 0.0}})


@pytest.mark.parametrize("name", ZEROS)
def test_what_is_zero_has_no_relative_slack(name):
    """Each slack has a width above 0 and changes something; the others stay."""
    nuisance = {
        (effect, member) for effect, member, _, width in nuisance_parameters(without(name), SETTINGS) if width > 0
    }
    usual = {(effect, member) for effect, member, *_ in nuisance_parameters(PAPER, SETTINGS)}
    assert len(nuisance) == len(nuisance_parameters(without(name), SETTINGS))
    assert usual - nuisance == {entry for entry in usual if entry[0] in ZEROS[name]}


def test_a_vehicle_without_dead_band_is_diagnosed():
    """A zero in a vehicle's file makes no prior singular."""
    diagnosis = diagnose(flown(13.0), without("dead_band"), settings=SETTINGS)
    assert [effect.name for effect in diagnosis.effects] == ["dead_band"]


def test_of_a_log_of_hours_stretches_are_looked_at():
    """Five hours become an hour of stretches, spread evenly, and a finding says so; an hour stays as it is."""
    log = simulated_logs("paper", [{}], episodes=1, seconds=10.0)[0]
    (episode,) = log.episodes
    rows = np.arange(len(episode)).repeat(100)
    for seconds in (3000.0, 18000.0):
        arrays = {name: getattr(episode, name)[rows] for name in ("pose", "velocity", "commands")}
        long = replace(log, episodes=(replace(episode, t=np.linspace(0, seconds, len(rows)), filled=None, **arrays),))
        cut = stretches_of(long)
        assert cut.duration <= MOST_S
        assert (cut is long) is (seconds < MOST_S)
    assert [finding.code for finding in cut.findings][-1] == "stretches"
    begins = np.array([part.t[0] for part in cut.episodes])
    np.testing.assert_allclose(np.diff(begins), np.diff(begins).mean(), rtol=0.02)
    assert cut.episodes[-1].t[-1] > 17990.0
    assert [part.number for part in cut.episodes] == list(range(30))


@given(st.lists(st.integers(2, 60), min_size=1, max_size=6), st.integers(1, 5), st.integers(1, 20))
def test_pieces_of_a_log_lie_within_it(lengths, pieces, seconds):
    """As many as are asked for, in their order, none longer than asked and none across two episodes."""
    episodes = []
    for number, size in enumerate(lengths):
        where, rest = np.full((size, 6), float(number)), np.zeros((size, 6))
        episodes.append(Episode(number, np.arange(float(size)), where, rest, rest))
    log = FlightLog("log", tuple(episodes), ("x",), ())
    part = spread(log, pieces, float(seconds))
    assert [episode.number for episode in part.episodes] == list(range(pieces))
    for episode in part.episodes:
        whole = lengths[int(episode.pose[0, 0])]
        assert len(episode) and np.ptp(episode.pose) == 0
        assert episode.duration <= seconds and episode.duration >= min(seconds, whole - 1) - 2
    assert (np.diff([episode.pose[0, 0] for episode in part.episodes]) >= 0).all()
