"""Long logs: the marks of windows are reduced piece by piece, and what is over is not kept."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from flown_logs import fly, hold
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.motion.smooth import Smoothed, fields
from auv_torchrl.diagnosis.motion.windows import cut_windows
from auv_torchrl.diagnosis.which import weighing
from auv_torchrl.diagnosis.which.bench import Bench
from auv_torchrl.diagnosis.which.explanation import Explanation
from auv_torchrl.diagnosis.which.ground import Base
from auv_torchrl.diagnosis.which.hypotheses import load_settings
from auv_torchrl.diagnosis.which.screen import Field
from auv_torchrl.diagnosis.which.search import search
from auv_torchrl.vehicle import load_vehicle

SETTINGS = load_settings()
GAIN = {"thruster_gain": {"gain_4": 0.55}}
PIECE = 8  # windows


@pytest.fixture(scope="module")
def followed():
    """A bench of a short flight with a weak thruster, and its windows under the nominal vehicle."""
    vehicle = hold(load_vehicle("paper"))
    log = fly(vehicle, GAIN, seed=3, episodes=3, seconds=14.0)
    bench = Bench(cut_windows(log, SETTINGS.window_s, SETTINGS.lead_s, SETTINGS.bin_s), vehicle, SETTINGS)
    return bench, bench.follow()


@settings(deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 400))
def test_pieces_hold_every_window_once(windows, changes):
    """Pieces follow one another from the first window to the last, none larger than it may be."""
    pieces = list(weighing.in_pieces(windows, changes))
    rows = np.concatenate([np.arange(windows)[piece] for piece in pieces])
    np.testing.assert_array_equal(rows, np.arange(windows))
    assert all((piece.stop - piece.start - 1) * changes <= weighing.MARKS_AT_ONCE for piece in pieces)


@settings(max_examples=12, deadline=None)
@given(at_once=st.integers(1, 400), seed=st.integers(0, 100), around=st.booleans())
def test_a_quadratic_in_pieces_is_that_of_the_whole(followed, at_once, seed, around):
    """However many windows are taken at once, and whichever count, the quadratic is the same to rounding."""
    bench, base = followed
    rng = np.random.default_rng(seed)
    nothing = Explanation()
    atoms = rng.choice(len(bench.atoms), 5, replace=False)
    changes = [nothing.with_atom(bench.atoms[i], bench.vehicle) for i in atoms]
    middle = nothing.with_atom(bench.atoms[0], bench.vehicle) if around else None
    chosen = rng.random(len(bench.windows)) < 0.7

    def quadratic():
        return bench.quadratic(base, changes, middle, chosen=chosen)

    whole = quadratic()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(weighing, "MARKS_AT_ONCE", at_once)
        pieces = quadratic()
    size = np.sqrt(np.diag(whole.A))
    np.testing.assert_allclose(pieces.A, whole.A, rtol=0, atol=1e-9 * np.outer(size, size).max())
    np.testing.assert_allclose(pieces.b, whole.b, rtol=1e-9, atol=1e-9 * size.max())
    assert pieces.constant == pytest.approx(whole.constant, rel=1e-9)
    assert pieces.numbers == whole.numbers


def test_screening_a_longer_log_takes_little_more_memory(followed, monkeypatch):
    """A window more costs less than the marks of all changes on it, which would be several times as much at once."""
    bench, base = followed
    monkeypatch.setattr(weighing, "MARKS_AT_ONCE", PIECE * len(bench.atoms))
    times = (1, 5)
    peaks = [peak_of_screening(*repeated(bench, base, n)) for n in times]
    more = (times[1] - times[0]) * len(bench.windows)
    marks_of_a_window = base.state.residual[0].size * len(bench.atoms) * 8
    assert len(bench.windows) > 2 * PIECE
    assert peaks[1] - peaks[0] < more * marks_of_a_window


def repeated(bench, base, times):
    """The bench and the base of a log whose windows come several times."""
    rows = np.tile(np.arange(len(bench.windows)), times)
    longer = Bench(bench.windows.subset(rows), bench.vehicle, SETTINGS)
    longer.sigma, longer.followed = bench.sigma, bench.followed[rows]
    state = Smoothed(*(field[rows] for field in fields(base.state)))
    return longer, Base(base.explanation, base.vehicle, state, base.states[rows])


def peak_of_screening(bench, base):
    """Bytes that screening takes at its worst."""
    tracemalloc.start()
    try:
        Field.of(bench, base)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_what_lost_keeps_its_motion_and_no_slopes(followed):
    """Explanations that were simulated and lost can be compared with and begun from, and hold no slopes any more."""
    bench, base = followed
    found = search(bench, base, lambda *_: None)
    lost = [judged for judged in found.polished if judged is not found.best and judged is not found.none]
    assert found.best.base.state.slope.size and found.none.base.state.slope.size
    assert lost
    for judged in lost:
        assert not judged.base.state.slope.size and judged.slack_marks is None
        assert not bench.minor(judged) or judged.base.motion.shape[0] == len(bench.windows)
    again = bench.polish(replace(lost[0].explanation, slack={}), lost[0].base, rounds=0)
    assert again.base.state.slope.shape == found.none.base.state.slope.shape
