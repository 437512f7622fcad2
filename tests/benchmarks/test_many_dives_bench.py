"""The benchmark over many dives, small: what it flies, finds and writes."""

import pickle

import numpy as np
import pytest

from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.vehicle import load_vehicle
from benchmarks import provenance
from benchmarks.dives import __main__ as bench
from benchmarks.dives.fly import Series, fly_series
from benchmarks.published import SECTIONS

BEGIN, END = SECTIONS["dives.md", "dives"].marks


def test_dives_differ_in_trim_and_current_and_are_drawn_again_alike():
    """The same seed flies the same dives, no two of which are alike; another seed flies others."""
    vehicle = load_vehicle("paper")
    one, again, other = (fly_series(vehicle, Series(3, seed, 5.0)) for seed in (1, 1, 2))
    for a, b in zip(one, again, strict=True):
        np.testing.assert_array_equal(a.episodes[0].pose, b.episodes[0].pose)
    assert not np.array_equal(one[0].episodes[0].commands, one[1].episodes[0].commands)
    assert not np.array_equal(one[0].episodes[0].commands, other[0].episodes[0].commands)
    assert one[0].axes == ("x", "y", "z", "yaw")


def test_a_page_without_its_marks_is_refused(tmp_path, monkeypatch):
    """What it lacks is named, and the page stays as it was."""
    page = tmp_path / "dives.md"
    page.write_text(f"# Dives\n{BEGIN}\n")
    monkeypatch.setattr(bench, "PAGE", page)
    monkeypatch.setattr(provenance, "age", lambda commit, paths: 0)
    with pytest.raises(ValueError, match=f"followed by {END}: put both"):
        bench.publish(["| thruster 2 |"], 5, "0123abc")
    assert page.read_text() == f"# Dives\n{BEGIN}\n"


@pytest.mark.thorough
@pytest.mark.slow
def test_a_fading_thruster_is_noticed_over_flown_dives(tmp_path, monkeypatch):
    """Of three sound dives and six that lose 2 % of thruster 2 each, it alone is named before 8 % are lost."""
    gain = np.append(np.ones(3), 1 - 0.02 * np.arange(1, 7))
    series = Series(9, 5, 40.0, {"thruster_gain": {"gain_2": gain}})
    outcome = bench.run("thruster 2", load_vehicle("paper"), series, "thruster gain 2")
    first, *_ = outcome.record.alarms
    assert 0.02 * (first.dive - 2) < 0.08
    (change,) = outcome.record.changes
    assert outcome.labels([change.row]) == "thruster gain 2"
    assert change.at(np.arange(9))[-1] == pytest.approx(-0.12, abs=0.03)
    page = tmp_path / "dives.md"
    page.write_text(f"# Dives\n{BEGIN}\noutdated\n{END}\nrest\n")
    monkeypatch.setattr(bench, "PAGE", page)
    monkeypatch.setattr(provenance, "age", lambda commit, paths: 0)
    assert outcome.score is bench.Score.HALF, "it fades by two per cent a dive, not by one"
    bench.publish(bench.report([outcome], [], 5), 5, "0123abc")
    assert "| thruster 2 |" in page.read_text()
    assert "outdated" not in page.read_text()
    assert page.read_text().endswith("rest\n")


@pytest.mark.slow
def test_what_was_calibrated_can_be_sent_to_another_process():
    """The reference survives being sent, and tells the same of a dive."""
    logs = fly_series(load_vehicle("paper"), Series(2, 3, 30.0))
    reference = bench.learn_reference(logs[:1], load_vehicle("paper"), load_settings())
    sent = pickle.loads(pickle.dumps(reference))
    here, there = (bench.follow_dive(logs[1], one) for one in (reference, sent))
    np.testing.assert_allclose(here.h, there.h, rtol=1e-9)
