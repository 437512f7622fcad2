"""What a diagnosis leaves: the page is whole and marks the right thing, the files read back."""

import errno
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rerun.chunk import RrdReader

from auv_torchrl.diagnosis.report import named_files, report_page, summary_table, write_files
from auv_torchrl.diagnosis.report.charts import horizons, shares
from auv_torchrl.diagnosis.report.svg import decades, ticks
from auv_torchrl.diagnosis.report.wording import sentence
from auv_torchrl.diagnosis.scenario_file import alternatives_yaml, randomization_yaml, scenario_yaml
from auv_torchrl.diagnosis.verdict import (
    NOT_SHOWN,
    Alternative,
    Decision,
    Diagnosis,
    Errors,
    Estimate,
    FoundEffect,
    Hypothesis,
    Outcome,
    Verdict,
    from_json,
    to_json,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.envs.randomize import read_ranges
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.paths import config_names
from auv_torchrl.scenario import read_scenario
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.example import example, hydrodynamic, no_gap
from tests.hovering import ACTING

CHROMIUM = next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)
SECTIONS = {"summary", "verdict", "vehicle", "effects", "ranking", "curves", "gap", "where", "limits", "next", "log"}


@pytest.fixture(scope="module")
def diagnosis() -> Diagnosis:
    return example()


@pytest.fixture(scope="module")
def paper():
    return load_vehicle("paper")


class Ids(HTMLParser):
    """Collects ids, addresses and pictures of a page."""

    def __init__(self, page: str):
        super().__init__()
        self.ids, self.addresses = [], []
        self.feed(page)
        self.pictures = re.findall(r"<svg.*?</svg>", page, re.DOTALL)

    def handle_starttag(self, tag, attrs):
        """Remember what an element is called and where it leads."""
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "data", "action"):
                self.addresses.append(value)


def test_a_diagnosis_survives_its_file(diagnosis):
    """Reading diagnosis.json gives the diagnosis that was written, but for its trajectories."""
    for one in (diagnosis, no_gap(), hydrodynamic()):
        content = json.loads(json.dumps(to_json(one), allow_nan=False))
        assert content["version"] == 1
        assert from_json(content) == one


def test_an_unbounded_interval_is_null_in_the_file(diagnosis):
    """JSON has no infinity; an interval without an end comes back without an end."""
    open_ended = Estimate(0.5, -np.inf, np.inf, 1.0, "1")
    effect = replace(diagnosis.effects[0], parameters={"gain_4": open_ended})
    content = json.loads(json.dumps(to_json(replace(diagnosis, effects=(effect,))), allow_nan=False))
    assert content["effects"][0]["parameters"]["gain_4"]["high"] is None
    assert from_json(content).effects[0].parameters["gain_4"] == open_ended


def test_errors_that_have_no_number_come_back_without_one(diagnosis):
    """Where a simulation diverges or nothing was measured the file has null, and reads; not so anywhere else."""
    position = Errors((0.02, 0.3, 1.4, np.nan), (0.01, 0.02, 0.087, 0.2), (0.01, 0.01, 0.01, 0.01))
    lost = replace(diagnosis, gap=replace(diagnosis.gap, position_m=position))
    content = json.loads(json.dumps(to_json(lost), allow_nan=False))
    found = from_json(content).gap.position_m
    assert found is not None and found.after == position.after
    np.testing.assert_equal(found.before, position.before)
    content["gap"]["horizon_s"][0] = None
    with pytest.raises(ValueError, match=r"horizon_s\[0\] is None instead of a number"):
        from_json(content)


def test_another_version_is_refused(diagnosis):
    """A file of another version is an error that names both."""
    with pytest.raises(ValueError, match="version 2.*version 1"):
        from_json({**to_json(diagnosis), "version": 2})


def test_the_page_stands_alone(diagnosis, paper):
    """The page refers to nothing outside itself, has every section once, and its pictures are sound XML with names."""
    page = report_page(diagnosis, paper)
    found = Ids(page)
    assert set(found.addresses) <= {"data:,"}
    assert "url(" not in page and "@import" not in page and "<script" not in page
    assert sorted(found.ids) == sorted(set(found.ids))
    assert set(found.ids) >= SECTIONS
    assert len(found.pictures) >= 14
    for picture in found.pictures:
        assert ElementTree.fromstring(picture).attrib["aria-label"]


def test_the_page_says_what_the_diagnosis_says(diagnosis, paper):
    """Verdict, summary, parameters with intervals, regimes, limits, next flight and findings are on the page."""
    page = report_page(diagnosis, paper).replace("\u202f", " ")
    effect = diagnosis.effects[0]
    words = [diagnosis.summary, diagnosis.verdict.value, effect.sentence, "0.541 to 0.563", "97 %", "95 %"]
    words += ["Confirmed in MuJoCo", "44 → <b>1.9 cm</b>", "96 %"]
    words += [regime.when for regime in diagnosis.where.regime] + [sentence(line) for line in diagnosis.cannot_tell]
    words += [diagnosis.next_experiment.why, diagnosis.findings[0].sentence, "rows 9 to 10", "thruster gain of 4"]
    words += ["Set MOT_4_DIRECTION to 1.", "Look for weed."]
    for text in words:
        assert text in page


@pytest.mark.parametrize("faulty", range(1, 7))
def test_the_thruster_at_fault_is_marked_and_no_other(diagnosis, paper, faulty):
    """The drawings from above and from behind mark the named thruster alone."""
    effect = replace(diagnosis.effects[0], thrusters=(faulty,))
    page = report_page(replace(diagnosis, effects=(effect,)), paper)
    above = re.findall(r'<text class="thruster bad number"[^>]*>([^<]+)<', page)
    assert set(above) == {str(faulty)}
    assert len(above) == (2 if faulty > 4 else 1)


@pytest.mark.parametrize("verdict", (Verdict.EXPLAINED, Verdict.PARTLY_EXPLAINED))
def test_an_effect_that_is_no_likelier_than_not_is_never_told_as_a_fact(diagnosis, paper, verdict):
    """The page says "perhaps" before it, and marks no thruster for it."""
    effect = replace(diagnosis.effects[0], probability=0.4)
    quiet = replace(diagnosis.where, thruster={})
    page = report_page(replace(diagnosis, verdict=verdict, effects=(effect,), where=quiet), paper)
    assert "Perhaps (40 %) thruster 4 gives 0.55 times" in page
    assert "thruster bad" not in page.split("</style>")[1]


def test_an_axis_is_marked_where_no_thruster_is_at_fault():
    """Drag in surge marks the surge axis and no thruster."""
    diagnosis = hydrodynamic()
    page = report_page(diagnosis, load_vehicle(diagnosis.vehicle))
    assert re.findall(r'<text class="axis bad label"[^>]*>([^<]+)<', page) == ["surge"]
    assert "thruster bad" not in page.split("</style>")[1]


@pytest.mark.parametrize("name", config_names("vehicle"))
@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_on_every_vehicle_has_a_page(diagnosis, verdict, name):
    """A page can be made of any verdict, with as little as there may be to say."""
    bare = replace(no_gap(), verdict=verdict, windows=(), candidates=(), detectable={})
    for one in (replace(diagnosis, verdict=verdict), bare):
        page = report_page(one, load_vehicle(name))
        assert (verdict.value in page) is (verdict is not Verdict.UNEXPLAINED)  # there the summary says the same
        assert "None" not in page and "nan" not in Ids(page).ids


def test_a_page_is_the_same_whether_its_template_is_kept_compiled_or_not(diagnosis, paper, tmp_path, monkeypatch):
    """Where it is kept it is read from there the next time, and where nothing can be kept it is compiled."""
    monkeypatch.setattr("auv_torchrl.diagnosis.report.page.cache_folder", lambda: tmp_path)
    first = report_page(diagnosis, paper)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "pages").iterdir()}
    assert kept
    assert report_page(diagnosis, paper) == first
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "pages").iterdir()}
    (tmp_path / "file").touch()
    monkeypatch.setattr("auv_torchrl.diagnosis.report.page.cache_folder", lambda: tmp_path / "file")
    assert report_page(diagnosis, paper) == first


@pytest.mark.parametrize("damage", ["full", "cut", "no folder"])
def test_a_cache_of_templates_costs_no_page(diagnosis, paper, tmp_path, monkeypatch, damage):
    """Where there is no room, what was kept is cut, or the user has no home folder."""
    monkeypatch.setattr("auv_torchrl.diagnosis.report.page.cache_folder", lambda: tmp_path)
    whole = report_page(diagnosis, paper)
    if damage == "cut":
        for path in (tmp_path / "pages").iterdir():
            path.write_bytes(path.read_bytes()[:-20])

    def fails(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    if damage == "full":
        shutil.rmtree(tmp_path / "pages")
        monkeypatch.setattr("jinja2.bccache.tempfile.NamedTemporaryFile", fails)
    if damage == "no folder":
        monkeypatch.setattr("auv_torchrl.diagnosis.report.page.cache_folder", fails)
    assert report_page(diagnosis, paper) == whole


def test_names_of_files_cannot_smuggle_markup(diagnosis, paper):
    """What stands in a log's name or summary is shown, not run."""
    evil = "<script>alert(1)</script>"
    page = report_page(replace(diagnosis, log=evil, summary=evil, cannot_tell=(evil,)), paper)
    assert "<script" not in page
    assert "&lt;script&gt;" in page


HOSTILE = "x\"'/><script>alert(1)</script>\x1b[31m\n- evil: {a}\u2028#\udcff\u202e.csv"


def test_text_of_a_file_does_nothing_in_any_file_that_is_written(diagnosis, paper, tmp_path):
    """Names of logs, vehicles and parameters neither run in the page nor add lines to YAML or parameters."""
    smuggled = Finding(Severity.WARNING, "x", "set", "do", param=(("MOT_1_DIRECTION\nARMING_CHECK", 0.0), ("A_B", 1.0)))
    hostile = replace(diagnosis, log=HOSTILE, vehicle=HOSTILE, summary=HOSTILE, findings=(smuggled,))
    write_files(hostile, paper, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(errors="surrogateescape")
    assert "<script" not in page and 'x"' not in page
    for name, first in (("scenario.yaml", scenario_yaml), ("randomization.yaml", randomization_yaml)):
        content = (tmp_path / "out" / name).read_text()
        assert "\x1b" not in content and "evil" not in yaml.safe_load(content)
        assert yaml.safe_load(content) == yaml.safe_load(first(diagnosis, paper))
    assert "ARMING_CHECK" not in (tmp_path / "out" / "advice.param").read_text()
    assert "A_B,1\n" in (tmp_path / "out" / "advice.param").read_text()


def test_text_in_a_picture_does_nothing():
    """What stands in a chart, and what is read out of it, is text."""
    shown = str(shares(HOSTILE, {HOSTILE: 0.5}))
    assert "<script" not in shown and 'x"' not in shown


def test_labels_of_the_error_chart_lie_over_no_curve():
    """Neither the floor nor another curve runs through a value."""
    errors = Errors((0.014, 0.043, 0.16, 0.73), (0.0082, 0.021, 0.036, 0.16), (0.011, 0.018, 0.027, 0.041))
    chart = ElementTree.fromstring(str(horizons("Position error", "m", (0.5, 1, 2, 5), errors)))
    labels = [label for label in chart.iter("text") if "value" in label.get("class", "")]
    curves = [
        np.array([pair.split() for pair in re.split("[ML]", curve.get("d", ""))[1:]], float)
        for curve in chart.iter("path")
    ]
    assert len(labels) >= 6 and len(curves) == 3
    for label in labels:
        x, y = float(label.get("x", "")), float(label.get("y", ""))
        across = np.linspace(max(x - 15, curves[0][0, 0]), min(x + 15, curves[0][-1, 0]), 20)
        for curve in curves:
            heights = np.interp(across, *curve.T)
            assert not ((heights > y - 9) & (heights < y)).any(), label.text


def test_all_files_are_written_and_none_twice(diagnosis, paper, tmp_path):
    """A folder gets every file complete, the console names those for people; a second time is refused."""
    written = write_files(diagnosis, paper, tmp_path / "out")
    names = {"report.html", "diagnosis.json", "scenario.yaml", "randomization.yaml", "predictions.parquet"}
    assert {path.name for path in written} == names | {"advice.param", "next_experiment.csv", "diagnosis.rrd"}
    named = "report.html, diagnosis.json, scenario.yaml, advice.param and next_experiment.csv"
    assert named_files(written) == named
    few = write_files(no_gap(), paper, tmp_path / "few")
    assert named_files(few) == "report.html, diagnosis.json and scenario.yaml"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {path.name for path in written}
    with pytest.raises(FileExistsError, match=r"report\.html"):
        write_files(diagnosis, paper, tmp_path / "out")


def test_predictions_hold_every_held_out_sample(diagnosis, paper, tmp_path):
    """predictions.parquet has measured, before and after of every sample, and the experiment can be flown as it is."""
    write_files(diagnosis, paper, tmp_path)
    table = pyarrow.parquet.read_table(tmp_path / "predictions.parquet").to_pandas()
    assert len(table) == sum(len(window.t) for window in diagnosis.windows)
    second = table[table.window == 1]
    np.testing.assert_array_equal(second.measured_x, diagnosis.windows[1].measured.pose[:, 0])
    np.testing.assert_array_equal(second.before_yaw, diagnosis.windows[1].before.pose[:, 5])
    np.testing.assert_array_equal(second.after_u, diagnosis.windows[1].after.velocity[:, 0])
    flown = pyarrow.csv.read_csv(tmp_path / "next_experiment.csv")
    assert flown.column_names == ["t", *(f"cmd_{i}" for i in range(1, 7))]
    assert np.abs(flown["cmd_1"].to_numpy()).max() <= 1


def test_the_recording_has_three_vehicles_on_one_timeline(diagnosis, paper, tmp_path):
    """measured, before and after move together, and measured is where it was measured."""
    write_files(diagnosis, paper, tmp_path)
    times, places = {}, {}
    for chunk in RrdReader(tmp_path / "diagnosis.rrd").stream():
        name = chunk.entity_path.removeprefix("/world/")
        batch = chunk.to_record_batch()
        if name in ("measured", "before", "after") and "time" in batch.schema.names:
            times[name] = [moment.total_seconds() for moment in batch.column("time").to_pylist()]
            column = next(c for c in batch.schema.names if c.endswith("Transform3D:translation"))
            places[name] = np.array(batch.column(column).to_pylist())[:, 0]
    assert set(times) == {"measured", "before", "after"}
    assert times["measured"] == times["before"] == times["after"]
    assert (np.diff(times["measured"]) > 0).all()
    measured = np.concatenate([window.measured.pose[:, :3] for window in diagnosis.windows])
    np.testing.assert_allclose(places["measured"], measured, atol=1e-5)


def test_the_scenario_brings_back_what_was_found(diagnosis, paper):
    """scenario.yaml is a scenario: it reads, and the vehicle in it has the values of the diagnosis."""
    scenario = read_scenario("found", yaml.safe_load(scenario_yaml(diagnosis, paper)), paper)
    assert float(scenario.vehicle_at(paper).gain[3]) == pytest.approx(0.552)


def test_the_scenario_sets_in_when_the_vehicle_changed(diagnosis, paper):
    """An onset that was found becomes start_s: nominal before it, changed behind it."""
    where = replace(diagnosis.where, onset_s=72.0, onset_episode=2, onset_in_episode_s=12.0)
    text = scenario_yaml(replace(diagnosis, where=where), paper)
    scenario = read_scenario("found", yaml.safe_load(text), paper)
    assert scenario.switching_times() == [12.0]
    assert float(scenario.vehicle_at(paper, 11.9).gain[3]) == 1.0
    assert float(scenario.vehicle_at(paper, 12.0).gain[3]) == pytest.approx(0.552)


def test_ranges_around_it_can_be_randomized(diagnosis, paper):
    """randomization.yaml is a randomization over the intervals."""
    ranges = read_ranges(paper, yaml.safe_load(randomization_yaml(diagnosis, paper)))
    assert [(effect.name, members) for effect, members in ranges] == [("thruster_gain", {"gain_4": (0.541, 0.563)})]


@pytest.mark.parametrize("name", config_names("vehicle"))
@pytest.mark.parametrize("effect", ACTING.values(), ids=ACTING)
def test_every_effect_can_be_written_as_a_scenario(diagnosis, effect, name):
    """Each effect with all of its parameters, far outside their bounds, gives files that read."""
    vehicle = load_vehicle(name)
    parameters = {
        member: Estimate(1e6, -1e9, np.inf, effect.nominal(vehicle)[member], p.unit)
        for member, p in effect.member_parameters(vehicle).items()
    }
    if effect.name == "thruster_swap":
        parameters = {f"command_{i}": Estimate(j, j, j, i, "1") for i, j in ((1, 2), (2, 1))}
    found = replace(
        diagnosis, effects=(FoundEffect(effect.name, 1.0, parameters, (), None, "x"),), summary="two\nlines"
    )
    scenario = read_scenario("found", yaml.safe_load(scenario_yaml(found, vehicle)), vehicle)
    assert set(scenario.changes[0].values) == set(parameters)
    read_ranges(vehicle, yaml.safe_load(randomization_yaml(found, vehicle)))


def test_each_other_explanation_is_a_scenario_of_its_own(diagnosis, paper):
    """With the values of its best fit; the explanation of scenario.yaml and what was not fitted are not among them."""

    def fitted(effects, parameters, proposed="", outcome=Outcome.NO_GAIN):
        return Hypothesis(effects, parameters, -10.0, 0.0, 1.0, proposed, outcome)

    own, drag, load = diagnosis.effects[0].name, "quadratic_drag", "buoyancy"
    trace = (
        replace(fitted((drag,), {f"{drag}.scale_surge": 3.0}), log_evidence=-12.0),
        fitted((drag,), {f"{drag}.scale_surge": 2.5}),
        fitted((drag, load), {f"{drag}.scale_surge": 1.5, f"{load}.force": 1e9}),
    )
    either = [Alternative((own,), "", 0.4), Alternative((drag,), "", 0.3), Alternative((drag, load), "", 0.2)]
    either += [Alternative(("tether",), "", 0.05), Alternative((), "something unknown", 0.05)]
    found = replace(diagnosis, alternatives=tuple(either), decision=Decision(trace), effects=diagnosis.effects[:1])
    one, two = (read_scenario("other", yaml.safe_load(text), paper) for text in alternatives_yaml(found, paper))
    assert {change.effect.name: change.values for change in one.changes} == {drag: {"scale_surge": 2.5}}
    assert {change.effect.name: change.values for change in two.changes} == {
        drag: {"scale_surge": 1.5},
        load: {"force": EFFECTS[load].parameters[0].high},
    }


def test_no_effect_is_the_empty_scenario(paper):
    """A healthy vehicle gives a scenario that changes nothing."""
    assert not read_scenario("found", yaml.safe_load(scenario_yaml(no_gap(), paper)), paper).changes


def test_the_table_names_value_and_interval(diagnosis):
    """The console shows summary, value, interval, the share that is closed, and what to do."""
    table = summary_table(diagnosis).replace("\u202f", " ")
    for text in (
        diagnosis.summary,
        "gain 4",
        "0.552",
        "0.541 to 0.563",
        "97 %",
        "5 s",
        "position, cm     before         2.0       6.0        15        43",
        "there: 96 %",
        "what to do",
        f"Fly next_experiment.csv: {diagnosis.next_experiment.why}",
        "Set MOT_4_DIRECTION to 1.",
    ):
        assert text in table
    assert "not defined" in summary_table(no_gap())


def test_the_table_warns_of_what_the_diagnosis_found_and_not_twice():
    """Warnings and errors with their remedies, each once and not if they were printed before; no infos."""
    unfollowed = Finding(Severity.WARNING, "axes_not_followed", "x and y cannot be used without yaw", "Log yaw too")
    known = Finding(Severity.ERROR, "gap", "1.20 s without data", "Log on")
    minor = Finding(Severity.INFO, "sensor_noise", "white noise of the sensors")
    to_set = Finding(Severity.WARNING, "motor_direction", "it is -1", "Set it to 1", param=(("MOT_4_DIRECTION", 1),))
    diagnosis = replace(no_gap(), findings=(unfollowed, known, minor, unfollowed, to_set))
    table = summary_table(diagnosis, printed={known.sentence})
    assert table.count("  warning: x and y cannot be used without yaw. Log yaw too.") == 1
    assert known.sentence not in table and minor.sentence not in table
    assert table.count("Set it to 1") == 1
    assert f"  error: {known.sentence}. Log on." in summary_table(diagnosis)


def test_the_table_says_what_the_log_cannot_tell_but_for_effects_without_a_mark():
    """What is not measured and what is at its bound; effects without a mark, a dozen of them, are on the page alone."""
    silent = ("yaw is not measured", f"gyro_bias {NOT_SHOWN}", "thruster_lag: rate is at its bound 0.9 1/s")
    table = summary_table(replace(no_gap(), cannot_tell=silent))
    assert "  Yaw is not measured.\n" in table and "rate is at its bound 0.9" in table
    assert "Thruster lag: rate" in table and "gyro bias" not in table


def test_a_simulator_that_diverges_without_the_effects_is_not_said_to_show_no_gap(diagnosis, paper):
    """Console and page say that it diverges, and how errors shrink at the last horizon that has numbers."""
    position = Errors((0.02, 0.3, 1.4, np.nan), (0.01, 0.02, 0.087, 0.2), (0.01, 0.01, 0.01, 0.01))
    gap = replace(diagnosis.gap, position_m=position, yaw_rad=None, closed=None)
    lost = replace(diagnosis, gap=gap)
    words = "without the effects the simulator diverges; position 1.4 → 0.087 m at 2 s"
    assert f"that is closed: not defined, {words}" in summary_table(lost)
    page = report_page(lost, paper)
    assert f"No share can be told: {words}." in page and "no more than the floor" not in page
    unseen = replace(position, after=(0.01, 0.02, 0.087, np.nan))  # no sample that late
    told = summary_table(replace(lost, gap=replace(gap, position_m=unseen)))
    assert "diverges" not in told and "held-out flight shows none" in told


def test_the_table_keeps_words_and_numbers_apart():
    """No verdict is said twice, and small errors have a unit in which they are short."""
    wide = Errors((0.00059,) * 4, (0.00082,) * 4, (0.00021,) * 4)
    gap = replace(no_gap().gap, position_m=wide)
    table = summary_table(replace(no_gap(), headline="No gap: it flies as it should.", gap=gap))
    assert table.startswith("No gap: it flies")
    assert "position, mm     before        0.59      0.59      0.59      0.59" in table


@pytest.mark.parametrize("make", [example, no_gap, hydrodynamic])
def test_every_line_of_the_table_but_sentences_fits_80_columns(make):
    """Effects with every parameter that there is, in numbers of any size, and errors of any size."""
    diagnosis = make()
    wide = {
        member: Estimate(-1.234e-7, -123456.7, 2.3456e-5, 0.123, p.unit)
        for effect in EFFECTS.values()
        for member, p in effect.member_parameters(load_vehicle("bluerov2_heavy")).items()
    }
    found = tuple(FoundEffect(name, 0.999, wide, (), None, "x") for name in EFFECTS)
    gap = replace(diagnosis.gap, velocity=Errors((1.23e-5,) * 4, (1234.5,) * 4, (np.nan,) * 4))
    bare = replace(diagnosis, effects=found, gap=gap, summary="x", findings=(), next_experiment=None)
    table = summary_table(bare).partition("\nwhat ")[0]
    for line in table.splitlines():
        assert len(line) <= 80 or line.startswith("share of")
        assert not re.search(r"\d 1$|[a-z]_[a-z]", line)


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_ticks_are_few_and_inside(low, span):
    """An axis has between one and six ticks, all of them inside."""
    high = low + span
    found = ticks(low, high)
    assert len(found) <= 6
    assert all(low - 1e-6 * span <= tick <= high + 1e-6 * span for tick in found)


@given(st.floats(-8, 8), st.floats(0.3, 6))
def test_decades_are_inside(low, span):
    """A logarithmic axis has its ticks inside."""
    assert all(low <= np.log10(tick) <= low + span for tick in decades(low, low + span))


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
@pytest.mark.parametrize(("dark", "width"), [(False, 1200), (True, 500)])
def test_a_browser_shows_the_page_without_complaint(diagnosis, paper, tmp_path, dark, width):
    """Chromium loads the page, reports no error, has drawn every figure with a size and needs no sideways scrolling."""
    probe = """<script>
      const boxes = [...document.querySelectorAll("svg")].map(e => e.getBoundingClientRect());
      document.documentElement.dataset.drawn = boxes.filter(b => b.width > 50 && b.height > 10).length;
      document.documentElement.dataset.wide = document.documentElement.scrollWidth > window.innerWidth;
      document.documentElement.dataset.paper = getComputedStyle(document.body).backgroundColor;
    </script></body>"""
    page = report_page(diagnosis, paper)
    (tmp_path / "report.html").write_text(page.replace("</body>", probe), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--no-first-run"]
    options += [f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},900", "--enable-logging=stderr"]
    options += ["--force-dark-mode"] * dark
    command = [str(CHROMIUM), *options, "--dump-dom", (tmp_path / "report.html").as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, check=True)
    complaints = [line for line in shown.stderr.splitlines() if "CONSOLE" in line]
    assert not complaints
    data = dict(re.findall(r'data-(\w+)="([^"]*)"', shown.stdout[:2000]))
    assert int(data["drawn"]) == len(Ids(page).pictures)
    assert data["wide"] == "false"
    assert data["paper"] == ("rgb(16, 22, 29)" if dark else "rgb(255, 255, 255)")


def test_the_recording_passes_the_viewers_own_check(diagnosis, paper, tmp_path):
    """``rerun rrd verify`` accepts diagnosis.rrd."""
    write_files(diagnosis, paper, tmp_path / "out")
    home = {"HOME": str(tmp_path), "RERUN_ANALYTICS": "0", "PATH": "/usr/bin:/bin"}
    command = [str(Path(sys.executable).parent / "rerun"), "rrd", "verify", str(tmp_path / "out" / "diagnosis.rrd")]
    assert subprocess.run(command, env=home, capture_output=True).returncode == 0
