"""Where the gap lies: what a gap goes with that no effect explains, the regimes it stands out in, and its onset."""

from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold

from auv_torchrl.diagnosis.identify.before_effects import find_onset
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.localize.attribute import attribute, in_turn, stuck
from auv_torchrl.diagnosis.localize.locate import gap_by_window, regimes
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.vehicle import load_vehicle

HELD = hold(load_vehicle("paper"))
SETTINGS = load_settings()
SHORT = {"episodes": 3, "seconds": 16.0}


def followed(log):
    """A problem and the windows of a log under the nominal vehicle."""
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), HELD, SETTINGS)
    return follow_windows(problem)


def sticky(commands, position, velocity, t):
    """Thruster 3 gives thrust that falls with the square of its command."""
    changed = commands.copy()
    changed[:, 2] = commands[:, 2] * (1 - np.abs(commands[:, 2])) - 0.15 * np.abs(commands[:, 2])
    return changed, np.zeros_like(position)


def drift(commands, position, velocity, t):
    """A force that depends on place."""
    return commands, 15.0 * np.sign(position) * np.array([1.0, 1.0, 0.0])


@pytest.mark.parametrize(
    ("change", "push", "origin"),
    [
        ({}, sticky, "actuation"),
        ({"quadratic_drag": {"scale_surge": 3.0, "scale_sway": 3.0}}, None, "flow"),
        ({"added_mass": {"scale_surge": 2.5, "scale_sway": 2.5}}, None, "body"),
        ({}, drift, "external"),
    ],
)
def test_a_gap_is_traced_to_its_origin(change, push, origin):
    """Without naming an effect, most of the gap goes to the kind of force that made it; shares sum to 1."""
    problem, path = followed(fly(HELD, change, seed=3, push=push, **SHORT))
    shares, thrusters = attribute(problem, path)
    assert max(shares, key=lambda name: shares[name]) == origin
    assert shares[origin] > 0.6
    assert sum(shares.values()) == pytest.approx(1.0)
    if origin == "actuation":
        assert thrusters["3"] > 0.8
        assert sum(thrusters.values()) == pytest.approx(1.0)
    else:
        assert thrusters == {}


def test_noise_alone_has_no_origin():
    """Where nothing but sensor noise is left, nothing is blamed."""
    problem, path = followed(fly(HELD, {}, seed=4, **SHORT))
    assert attribute(problem, path) == ({}, {})


def test_two_that_explain_the_same_share_it():
    """Equals divide what they add, a third gets what it adds to both, the worthless nothing."""
    worth = {0: 0.5, 1: 0.5, 2: 0.2, 3: 0.0}
    shares = in_turn(
        lambda some: max((worth[i] for i in some if i < 2), default=0.0) + 0.2 * (2 in some), [[0], [1], [2], [3]]
    )
    np.testing.assert_allclose(shares, [0.25, 0.25, 0.2, 0.0])


def test_sticking_commands_move_only_far_enough():
    """A held command follows once it differs by more than the width."""
    commands = np.array([0.0, 0.05, 0.2, 0.25, 0.1])[None, :, None]
    np.testing.assert_allclose(stuck(commands, 0.1)[0, :, 0], [0.0, 0.0, 0.2, 0.2, 0.2])


def test_regimes_name_where_a_gap_stands_out():
    """A force that acts in the south alone stands out there, and not in the north."""
    south = 12.0 * np.array([0.0, 0.0, 1.0])
    problem, path = followed(
        fly(
            HELD,
            {},
            seed=5,
            push=lambda c, x, v, t: (c, np.where(x[:, :1] < -0.2, south, 0.0 * x)),
            episodes=6,
            seconds=20.0,
        )
    )
    named = [regime.when for regime in regimes(problem, path, gap_by_window(problem, path))]
    assert any(when.startswith("south of x") for when in named)
    assert not any(when.startswith("north of x") for when in named)


def test_an_onset_is_found_with_its_episode():
    """A thruster that weakens 12 s into the second of two episodes is dated to within a window."""

    def weaken(commands, position, velocity, t):
        changed = commands.copy()
        changed[:, 1] *= 0.3 if t > 12.0 else 1.0
        return changed, np.zeros_like(position)

    sound = fly(HELD, {}, seed=6, episodes=1, seconds=30.0)
    ill = fly(HELD, {}, seed=7, episodes=2, seconds=30.0, push=weaken)
    second = replace(ill.episodes[1], number=5)
    problem, path = followed(replace(sound, episodes=(sound.episodes[0], second)))
    found = find_onset(problem, path)
    assert found is not None
    assert found.episode == 5
    assert found.episode_s == pytest.approx(12.0, abs=1.5)
    assert found.log_s == pytest.approx(30.0 + found.episode_s, abs=2.0)


@pytest.mark.parametrize("windows", range(1, 15, 3))
@pytest.mark.parametrize("lost", [0, 3])
def test_no_number_of_windows_is_too_small_to_ask(windows, lost):
    """However few windows there are, and whatever of them diverged, the search for an onset comes to an end."""
    problem, path = followed(fly(HELD, {}, seed=6, **SHORT))
    some = np.arange(len(problem.windows)) < windows
    problem = replace(problem, windows=problem.windows.subset(some))
    bins = path.state.bins[some].copy()
    bins[:lost] = np.nan
    assert find_onset(problem, replace(path, state=replace(path.state, bins=bins))) is None
