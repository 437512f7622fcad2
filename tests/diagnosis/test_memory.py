"""Long logs: the marks of windows are reduced piece by piece, and what is over is not kept."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.identify import paths
from auv_torchrl.diagnosis.identify.explanation import Explanation
from auv_torchrl.diagnosis.identify.fit import fit_by_simulation
from auv_torchrl.diagnosis.identify.following import follow_windows
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.identify.paths import WindowPath
from auv_torchrl.diagnosis.identify.problem import Problem
from auv_torchrl.diagnosis.identify.screen import Field
from auv_torchrl.diagnosis.identify.search import search
from auv_torchrl.diagnosis.motion import tangent
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.tangent import Slopes
from auv_torchrl.vehicle import load_vehicle

SETTINGS = load_settings()
GAIN = {"thruster_gain": {"gain_4": 0.55}}
PIECE = 8  # windows


@pytest.fixture(scope="module")
def followed():
    """A problem of a short flight with a weak thruster, and its windows under the nominal vehicle."""
    vehicle = hold(load_vehicle("paper"))
    log = fly(vehicle, GAIN, seed=3, episodes=3, seconds=14.0)
    problem = Problem.of(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    return follow_windows(problem)


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 400))
def test_pieces_hold_every_window_once(windows, changes):
    """Pieces follow one another from the first window to the last, none larger than it may be."""
    pieces = list(paths.in_pieces(windows, changes))
    rows = np.concatenate([np.arange(windows)[piece] for piece in pieces])
    np.testing.assert_array_equal(rows, np.arange(windows))
    assert all((piece.stop - piece.start - 1) * changes <= paths.RESPONSES_AT_ONCE for piece in pieces)


@settings(max_examples=12, deadline=None)
@given(at_once=st.integers(1, 400), seed=st.integers(0, 100), around=st.booleans())
def test_a_quadratic_in_pieces_is_that_of_the_whole(followed, at_once, seed, around):
    """However many windows are taken at once, and whichever count, the quadratic is the same to rounding."""
    problem, path = followed
    rng = np.random.default_rng(seed)
    nothing = Explanation()
    candidates = rng.choice(len(problem.candidates), 5, replace=False)
    changes = [nothing.with_candidate(problem.candidates[i], problem.vehicle) for i in candidates]
    middle = nothing.with_candidate(problem.candidates[0], problem.vehicle) if around else None
    chosen = rng.random(len(problem.windows)) < 0.7

    def chi_square():
        return paths.quadratic(problem, path, changes, middle, chosen=chosen)

    whole = chi_square()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(paths, "RESPONSES_AT_ONCE", at_once)
        pieces = chi_square()
    size = np.sqrt(np.diag(whole.A))
    np.testing.assert_allclose(pieces.A, whole.A, rtol=0, atol=1e-9 * np.outer(size, size).max())
    np.testing.assert_allclose(pieces.b, whole.b, rtol=1e-9, atol=1e-9 * size.max())
    assert pieces.constant == pytest.approx(whole.constant, rel=1e-9)
    assert pieces.numbers == whole.numbers


@pytest.mark.thorough
def test_screening_a_longer_log_takes_little_more_memory(followed, monkeypatch):
    """A window more costs less than the marks of all changes on it, which would be several times as much at once."""
    problem, path = followed
    monkeypatch.setattr(paths, "RESPONSES_AT_ONCE", PIECE * len(problem.candidates))
    times = (1, 5)
    peaks = [peak_of_screening(*repeated(problem, path, n)) for n in times]
    more = (times[1] - times[0]) * len(problem.windows)
    marks_of_a_window = path.state.residual[0].size * len(problem.candidates) * 8
    assert len(problem.windows) > 2 * PIECE
    assert peaks[1] - peaks[0] < more * marks_of_a_window


def repeated(problem, path, times):
    """The problem and the path of a log whose windows come several times."""
    rows = np.tile(np.arange(len(problem.windows)), times)
    longer = Problem.of(problem.windows.subset(rows), problem.vehicle, SETTINGS)
    longer = replace(longer, sigma=problem.sigma, followed=problem.followed[rows])
    slope = path.state.slope[rows]
    state = replace(path.state.rows(rows), slopes=Slopes(lambda: slope, slope))
    return longer, WindowPath(path.explanation, path.vehicle, state, path.states[rows], longer.windows)


def peak_of_screening(problem, path):
    """Bytes that screening takes at its worst."""
    tracemalloc.start()
    try:
        Field.of(problem, path)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_slopes_that_were_let_go_come_back_the_same(followed, monkeypatch):
    """Where there is no room for slopes, a search works them out again, and ends with the same numbers."""
    problem, path = followed
    whole = search(problem, path, lambda *_: None)
    monkeypatch.setattr(tangent, "HELD", 0)
    frugal = search(problem, path, lambda *_: None)
    held = [fit for fit in frugal.fits if fit.path.state.slopes.is_held]
    assert len(held) <= 1 < len(frugal.fits)
    assert [fit.chi2 for fit in frugal.fits] == [fit.chi2 for fit in whole.fits]
    np.testing.assert_array_equal(frugal.best.path.state.slope, whole.best.path.state.slope)


def test_what_lost_keeps_its_motion_and_no_slopes(followed):
    """Explanations that were simulated and lost can be compared with and begun from, and hold no slopes any more."""
    problem, path = followed
    found = search(problem, path, lambda *_: None)
    lost = [fit for fit in found.fits if fit is not found.best and fit is not found.none]
    assert found.best.path.state.slope.size and found.none.path.state.slope.size
    assert lost
    for fit in lost:
        assert not fit.path.state.slope.size and fit.nuisance_responses is None
        assert fit.path.motion.shape[0] == len(problem.windows)
    again = fit_by_simulation(problem, replace(lost[0].explanation, nuisance={}), lost[0].path, rounds=0)
    assert again.path.state.slope.shape == found.none.path.state.slope.shape
