"""Two versions of the diagnosis, log by log."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.paired import ALL, COUNTED, SECTION, Pair, difference, kind_of, tables
from benchmarks.blind.scores.judge import Judgement
from benchmarks.published import SECTIONS

SOUND = Judgement(
    case="case_0001", family="no_gap", plant="mujoco", truth="no_gap", effects=(), outside=None, left_out=None,
    scale=1.0, seconds_of_log=180.0, noise=1.0, influence=None, answer="no_gap", named=(), verdict="no_gap", right=True,
    right_class=True, thrusters_right=None, probability=1.0, probability_of_truth=1.0, closed=None, onset_error_s=None,
    seconds=4.0, cpu_s=4.0, score="right",
)  # fmt: skip


def test_the_interval_of_a_difference_holds_the_truth():
    """Of 100 pairs, 12 of which are gained and 4 lost, in 93 of 100 draws and more; and it turns with its sign."""
    rng, truth, held = np.random.default_rng(0), 0.08, 0
    for _ in range(400):
        gained, lost, _ = rng.multinomial(100, (0.12, 0.04, 0.84))
        _, low, high = difference(gained, lost, 100)
        held += low <= truth <= high
    assert held > 0.93 * 400
    assert difference(3, 1, 50)[1:] == tuple(-end for end in difference(1, 3, 50)[:0:-1])


def test_a_log_that_was_lost_is_told_with_both_answers():
    """Of three logs one was right and is wrong now: minus a third, one row, and one false alarm more."""
    lost = replace(SOUND, case="case_0002")
    accused = replace(lost, verdict="explained", named=("tether",), score="wrong")
    pairs = [Pair(SOUND, SOUND), Pair(lost, accused), Pair(SOUND, SOUND)]
    shares, counts, changed = tables(pairs, "before")
    assert [row[1:3] for row in shares.rows if row[0] == ALL] == [("3/3", "2/3")]
    assert [row[1:] for row in counts.rows if row[0] == next(iter(COUNTED))] == [("0", "1")]
    assert [row[0] for row in changed.rows] == ["case_0002"] and "tether" in changed.rows[0][-1]


@pytest.mark.parametrize(
    ("asked", "kind"), [({}, ""), ({"sensors": "stock"}, "stock"), ({"strangers": 2}, "strangers")]
)
def test_logs_of_each_kind_have_a_table_of_their_own(asked, kind, tmp_path):
    """By what their manifest says; each is among the published ones."""
    (tmp_path / "manifest.json").write_text(json.dumps({"settings": {"cases": 2, "seed": 1, **asked}, "tasks": {}}))
    assert kind_of(tmp_path) == kind and ("ablation.md", f"{SECTION} {kind}".strip()) in SECTIONS
