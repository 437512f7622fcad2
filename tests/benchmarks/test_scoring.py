"""Scoring gives full marks to the truth and none to its opposite."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.effects import get_effect
from auv_torchrl.flightlog import read_flightlog
from auv_torchrl.vehicle import load_vehicle
from benchmarks import published
from benchmarks.blind.flights.cases import FAMILIES, draw_cases
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.scores.figures import draw_figures
from benchmarks.blind.scores.judge import judge
from benchmarks.blind.scores.report import markdown, publish, write_report
from benchmarks.blind.scores.score import numbers, tables
from benchmarks.blind.scores.table import Share, calibration_error, reliability
from benchmarks.blind.scores.thrusters import thrusters_at_fault
from benchmarks.blind.seal import LABELS, hand_over, is_sealed, open_labels, read_manifest, seal

VEHICLE = load_vehicle("paper")


@pytest.fixture(scope="module")
def labels():
    """Labels of a benchmark with every family."""
    cases = draw_cases(2 * len(FAMILIES), dict.fromkeys(FAMILIES, 1.0), seed=4)
    short = [replace(case, plant="foreign", episodes=1, episode_s=12.0) for case in cases]
    return [{**label, "named_by": hand_over(log, label).named_by} for log, label in fly(short, VEHICLE, seed=1)]


def perfect(label, vehicle=VEHICLE):
    """The diagnosis that a label calls for."""
    effects = []
    for name, values in label["values"].items():
        nominal = get_effect(name).nominal(vehicle)
        thrusters = sorted(thrusters_at_fault(name, values, vehicle) or ())
        parameters = {
            k: {"value": v, "low": v - 0.01, "high": v + 0.01, "nominal": nominal[k], "unit": ""}
            for k, v in values.items()
        }
        effects.append({"name": name, "probability": 1.0, "parameters": parameters, "thrusters": thrusters})
    verdict = "explained" if effects else "no_gap"
    if label["truth"] == "unknown":
        effects, verdict = [], "unexplained"
    candidates = [{"name": e["name"], "probability": 1.0} for e in effects] or [{"name": "none", "probability": 1.0}]
    by = label.get("named_by")
    return {
        "diagnosis": {
            "verdict": verdict, "effects": effects, "candidates": candidates, "indistinguishable": [],
            "findings": [{"code": by["codes"][0], "columns": by["columns"]}] if by else [],
            "gap": {"closed": 1.0}, "where": {"onset_s": label["onset_s"]},
        },
        "seconds": 1.0, "cpu_s": 1.0,
    }  # fmt: skip


def blind_eye(label):
    """The diagnosis that never sees anything."""
    answer = perfect({**label, "values": {}, "truth": "no_gap"})
    answer["diagnosis"] |= {"candidates": [{"name": "none", "probability": 1.0}], "findings": []}
    return answer


def test_the_truth_gets_full_marks(labels):
    """An answer equal to the label is right in every family, with no error and full coverage."""
    judgements = [judge(str(i), label, perfect(label), VEHICLE) for i, label in enumerate(labels)]
    assert {j.family for j in judgements} == set(FAMILIES)
    assert all(j.right and j.right_class and j.thrusters_right is not False for j in judgements)
    assert {j.score for j in judgements} == {"right"}
    assert all(error < 1e-12 for j in judgements for error in j.errors.values())
    assert all(held for j in judgements for held in j.covered.values())
    text = markdown(numbers(judgements))
    assert "single effect named first | ≥ 95 % | ≥ 99 % | 100.0%" in text


@pytest.mark.parametrize(("apart", "numbers_told"), [(0.0, 1), (1.0, 6)])
def test_one_value_of_all_thrusters_counts_once(labels, apart, numbers_told):
    """One limit for six thrusters has one interval, which holds the truth or not; six limits have six."""
    limits = {f"limit_{i}": 20.0 + apart * i for i in range(1, 7)}
    of_one = next(label for label in labels if label["family"] == "single")
    label = {**of_one, "truth": "thrust_limit", "effects": ["thrust_limit"], "values": {"thrust_limit": limits}}
    assert list(judge("limits", label, perfect(label), VEHICLE).covered.values()) == [True] * numbers_told


def test_errors_come_in_the_order_of_the_parameters(labels):
    """Of mass, weight and place, so that the same answers give the same file of results, entry by entry."""
    of_one = next(label for label in labels if label["family"] == "single")
    values = {"payload": {"mass": 3.0, "weight": 5.0, "x": 0.1, "y": 0.0, "z": 0.0}}
    label = {**of_one, "truth": "payload", "effects": ["payload"], "values": values}
    assert list(judge("load", label, perfect(label), VEHICLE).errors) == ["payload [kg]", "payload [N]", "payload [m]"]


def test_seeing_nothing_gets_no_marks(labels):
    """An answer of no gap is right where there is none, and nowhere else."""
    judgements = [judge(str(i), label, blind_eye(label), VEHICLE) for i, label in enumerate(labels)]
    assert all(j.right == (j.score == "right") == (j.truth == "no_gap") for j in judgements)


def test_a_crash_is_a_wrong_answer(labels):
    """An error is scored as wrong and listed with its message."""
    crashed = {"error": "ValueError: nope", "seconds": 1.0, "cpu_s": 1.0}
    judgements = [judge(str(i), label, crashed, VEHICLE) for i, label in enumerate(labels)]
    assert not any(j.right or j.right_class for j in judgements)
    assert markdown(tables(judgements)[-1]).count("ValueError: nope") == len(labels)


def gain_label(thruster):
    return {
        "family": "single", "plant": "mujoco", "truth": "thruster_gain", "effects": ["thruster_gain"], "outside": None,
        "left_out": None, "scale": 1.0, "episodes": 6, "episode_s": 30.0, "noise": 1.0, "onset_s": None,
        "values": {"thruster_gain": {f"gain_{thruster}": 0.4}}, "influence": {"thruster_gain": 100.0},
    }  # fmt: skip


@pytest.mark.parametrize("prefix", ["thruster_gain ", "gain_", "heading_bias with thruster_gain "])
def test_a_wrong_thruster_counts_unless_it_was_declared_exchangeable(prefix):
    """Naming thruster 6 for 5 is wrong, and right where the log cannot tell them apart and the answer says so."""
    label, answer = gain_label(5), perfect(gain_label(6))
    assert judge("a", label, answer, VEHICLE).thrusters_right is False
    answer["diagnosis"]["indistinguishable"] = [[f"{prefix}5", f"{prefix}6"]]
    assert judge("a", label, answer, VEHICLE).thrusters_right is True
    answer["diagnosis"]["indistinguishable"] = [[f"{prefix}1", f"{prefix}5"]]
    assert judge("a", label, answer, VEHICLE).thrusters_right is False


def test_a_declared_class_counts_apart():
    """Pose delay for command delay is not the truth, but it is in its class where that was declared."""
    label = {
        **gain_label(1),
        "truth": "command_delay",
        "effects": ["command_delay"],
        "values": {"command_delay": {"delay": 0.2}},
    }
    answer = perfect({**label, "truth": "pose_delay", "values": {"pose_delay": {"delay": 0.2}}})
    judged = judge("a", label, answer, VEHICLE)
    assert (judged.right, judged.right_class) == (False, False)
    answer["diagnosis"]["indistinguishable"] = [["command_delay", "pose_delay"]]
    judged = judge("a", label, answer, VEHICLE)
    assert (judged.right, judged.right_class, judged.probability_of_truth) == (False, True, 1.0)


@given(st.integers(1, 500), st.data())
def test_wilson_interval_holds_the_share(n, data):
    """The interval contains the share, lies in [0, 1] and is narrower for more cases."""
    hits = data.draw(st.integers(0, n))
    share = Share(hits, n)
    low, high = share.interval
    assert 0 <= low <= share.value + 1e-12
    assert share.value - 1e-12 <= high <= 1
    low_more, high_more = Share(4 * hits, 4 * n).interval
    assert high_more - low_more < high - low


def test_wilson_interval_is_the_published_one():
    """Checked against Wilson's formula worked by hand for 0 of 100: the upper end is z^2 / (n + z^2)."""
    assert Share(0, 100).interval[1] == pytest.approx(1.959964**2 / (100 + 1.959964**2))


def test_calibration_error_finds_overconfidence():
    """Honest probabilities have a small error, claims of 0.95 that hold half the time one of 0.45."""
    rng = np.random.default_rng(0)
    p = rng.random(20_000)
    assert calibration_error(reliability(p.tolist(), (rng.random(20_000) < p).tolist())) < 0.02
    assert calibration_error(reliability([0.95] * 100, [True, False] * 50)) == pytest.approx(0.45)
    assert math.isnan(calibration_error([]))


def test_labels_are_sealed(tmp_path):
    """Tasks and logs tell nothing of the truth, and labels that were touched are refused."""
    cases = draw_cases(2, {"single": 1.0}, seed=0)
    short = [replace(case, effects=("current",), episodes=1, episode_s=5.0) for case in cases]
    settings = {"cases": 2, "seed": 0, "families": {"single": 1.0}}
    assert not is_sealed(tmp_path, settings)
    seal(tmp_path, settings, fly(short, VEHICLE, seed=0))
    assert is_sealed(tmp_path, settings)
    with pytest.raises(FileExistsError, match="other seed"):
        is_sealed(tmp_path, {**settings, "seed": 1})
    readable = (tmp_path / "manifest.json").read_text() + " ".join(p.name for p in (tmp_path / "logs").iterdir())
    assert "current" not in readable
    for name in read_manifest(tmp_path)["tasks"]:
        log = read_flightlog(tmp_path / "logs" / f"{name}.csv", VEHICLE)
        assert log.axes == ("x", "y", "z", "yaw")
        assert len(log.episodes) == 1
    assert set(open_labels(tmp_path)) == {"case_0001", "case_0002"}
    (tmp_path / LABELS).write_text((tmp_path / LABELS).read_text().replace("single", "no_gap"))
    with pytest.raises(ValueError, match="changed after it was sealed"):
        open_labels(tmp_path)


def test_report_fills_the_document_between_its_markers(labels, tmp_path, monkeypatch):
    """Tables and pictures land between the markers, twice the same, and the rest of the document stays."""
    judgements = [judge(str(i), label, perfect(label), VEHICLE) for i, label in enumerate(labels)]
    pictures = draw_figures(judgements, tmp_path)
    command = "python -m benchmarks.blind cases=60"
    text = write_report(judgements, tmp_path, command, tables(judgements), pictures)
    begin, end = published.SECTIONS["diagnosis.md", "blind"].marks
    monkeypatch.setattr(published.provenance, "age", lambda commit, paths: 0)
    document = tmp_path / "docs" / "diagnosis.md"
    document.parent.mkdir()
    document.write_text(f"# Before\n{begin}\nworn out\n{end}\nafter\n")
    publish(text, tmp_path, document, None, command, "0123abc")
    once = document.read_text()
    publish(text, tmp_path, document, None, command, "0123abc")
    assert document.read_text() == once
    assert once.startswith("# Before\n") and once.endswith("\nafter\n") and "worn out" not in once
    for picture in ("confusion", "reliability", "severity"):
        assert (document.parent / "figures" / f"{picture}.png").stat().st_size > 1000
    sections = {("diagnosis.md", "blind"): published.SECTIONS["diagnosis.md", "blind"]}
    (short,) = published.problems("diagnosis.md", once, sections, lambda commit, paths: 0)
    assert "cannot print the row 'log of 12 s" in short, "logs of this test are shorter than those of any benchmark"
    document.write_text("no markers")
    with pytest.raises(ValueError, match="put both where"):
        publish(text, tmp_path, document, None, command, "0123abc")
