"""Many dives: what changed is named, what did not is not, and page and file say the same."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from auv_torchrl.diagnosis.plain import from_plain, plain
from auv_torchrl.monitoring.changes import find_changes
from auv_torchrl.monitoring.dive_history import DiveDiagnosis, DiveHistory, console, make_history
from auv_torchrl.monitoring.dive_job import to_diagnose
from auv_torchrl.monitoring.dive_page import dives_page
from auv_torchrl.monitoring.dive_record import Dive, tracked_parameter
from auv_torchrl.vehicle import load_vehicle
from tests.monitoring.many_dives import BASELINE, PARAMETERS, REFERENCE, dives_of, fading, history_of

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
SECTIONS = {"summary", "verdict", "facts", "vehicle", "changes", "numbers", "dives", "limits"}


@pytest.fixture(scope="module")
def faded():
    return history_of(
        dives_of(fading()), diagnoses={8: DiveDiagnosis("explained", "Thruster 3 is weak.", "dives/009_dive_9")}
    )


@pytest.fixture(scope="module")
def paper():
    return load_vehicle("paper")


def keys(rows, dives):
    return [BASELINE.all_parameters(dives)[row].key for row in rows]


def test_a_fading_thruster_raises_an_alarm_in_time():
    """A thruster that fades by 1 % a dive raises an alarm before it lost 8 %, which names it and nothing else."""
    for seed in range(5):
        dives = dives_of(fading(), seed)
        record = find_changes(dives, BASELINE, REFERENCE, 1000.0)
        assert keys([alarm.row for alarm in record.alarms], dives) == ["thruster_gain.gain_3"]
        assert record.alarms[0].dive - REFERENCE + 1 < 8
        (change,) = record.changes
        assert change.shifts[0].is_drift
        assert change.shifts[0].size == pytest.approx(-0.01, abs=0.001)


def test_sound_dives_raise_no_alarm():
    """400 dives of sound vehicles, whose trim and current differ each time, raise at most one alarm."""
    changed = np.zeros((103, 5))
    changed[:, 4] = np.random.default_rng(9).uniform(-0.3, 0.3, 103)  # currents are the day's
    alarms = [find_changes(dives_of(changed, seed), BASELINE, REFERENCE, 1000.0).alarms for seed in range(4)]
    assert sum(map(len, alarms)) <= 1


def test_what_is_the_days_is_not_watched(paper):
    """A current is the day's; a gain, and what a vehicle's own file calls uncertain, are the vehicle's."""
    assert not tracked_parameter("current", "north", 0.0, paper).watched
    assert tracked_parameter("thruster_gain", "gain_3", 1.0, paper).watched
    assert tracked_parameter("hull", "linear_surge", 10.0, paper, file_width=3.0).watched
    assert not tracked_parameter("dead_band", "width", 5.0, paper, rough=True).watched


def test_what_dives_cannot_tell_apart_is_named_together():
    """Two thrusters that always get the same command are one answer: this one or that one."""
    changed = np.zeros((20, 5))
    changed[10:, 2] = -0.2
    dives = dives_of(changed)
    (change,) = find_changes(dives, BASELINE, REFERENCE, 1000.0).changes
    both = {*keys([change.row], dives), *keys(change.rivals, dives)}
    assert both == {"thruster_gain.gain_5", "thruster_gain.gain_6"}


def test_what_was_mended_needs_no_advice():
    """Weed that was caught at dive 9 and taken off before dive 15 is told, and nothing is to be done about it."""
    changed = np.zeros((25, 5))
    changed[8:14, 0] = -0.2
    (change,) = history_of(dives_of(changed)).changes
    assert [shift.dive for shift in change.shifts] == [9, 15]
    assert "by now it is as it was" in change.sentence
    assert not change.advice


def test_several_changes_are_one_line():
    """The summary names each number and its moment; the page has the rest."""
    changed = np.zeros((25, 5))
    changed[8:, 0], changed[15:, 3] = -0.2, 4.0
    history = history_of(dives_of(changed))
    assert history.summary.startswith("2 numbers changed: ")
    for words in ("thruster gain 3 since dive 9", "buoyancy force since dive 16"):
        assert words in history.summary


def test_a_change_that_is_no_likelier_than_not_is_told_as_perhaps(faded, paper):
    """Past the threshold of alarms it may still be none: no advice, no thruster in red, no verdict of a change."""
    changed = np.zeros((25, 5))
    changed[8:, 0] = -0.2
    record = find_changes(dives_of(changed), BASELINE, REFERENCE, 1000.0)
    (change,) = record.changes
    unsure = replace(change, shifts=tuple(replace(shift, probability=0.4) for shift in change.shifts))
    history = make_history(
        dives_of(changed), BASELINE, replace(record, changes=(unsure,)), paper, "paper", 1000.0, 1.15, {}
    )
    assert history.summary.startswith("Perhaps (40 %) thruster gain 3: ")
    assert not history.changes[0].advice
    page = dives_page(history, paper)
    assert "look closer" in page and "thruster bad" not in page.split("</style>")[1]


def test_a_noisier_sensor_is_a_change():
    """A channel that is 1.4 times as noisy from dive 11 on is named with its moment."""
    noise = np.where(np.arange(20) >= 10, 1.4, 1.0)
    history = history_of(dives_of(np.zeros((20, 5)), noise=noise))
    assert [change.number for change in history.changes] == ["noise.x"]
    assert history.changes[0].shifts[0].dive == 11


def test_a_dive_that_could_not_be_read_is_passed_over():
    """Console, page and file list it with the reason, and the rest is used without it, also of the reference."""
    dives = dives_of(fading())
    for place, name in ((1, "damaged.BIN"), (7, "broken.csv")):
        dives[place] = Dive.unread(name, f"no column t in {name}", len(PARAMETERS))
    history = history_of(dives)
    assert history.dives[7].refused == "no column t in broken.csv"
    assert not history.dives[7].values
    assert [dive.number for dive in history.dives if dive.is_reference] == [1, 3]
    assert [change.number for change in history.changes] == ["thruster_gain.gain_3"]
    for shown in (console(history), dives_page(history, load_vehicle("paper")), json.dumps(plain(history))):
        assert "no column t in broken.csv" in shown and "no column t in damaged.BIN" in shown


def test_dives_that_show_something_are_diagnosed_by_themselves():
    """By default those of alarms, the last one of a change, and those that no number explains; or all, or none."""
    dives = dives_of(fading())
    record = find_changes(dives, BASELINE, REFERENCE, 1000.0)
    odd = [replace(dive, excess=3.0) if i == 15 else dive for i, dive in enumerate(dives)]
    assert to_diagnose("changed", odd, record, 1.15) == sorted({record.alarms[0].dive, 15, len(dives) - 1})
    assert to_diagnose("all", dives, record, 1.15) == list(range(len(dives)))
    assert to_diagnose("none", odd, record, 1.15) == []
    sound = dives_of(np.zeros((20, 5)))
    assert to_diagnose("changed", sound, find_changes(sound, BASELINE, REFERENCE, 1000.0), 1.15) == []


def test_an_answer_survives_its_file(faded):
    """What dives.json holds is the whole answer."""
    assert from_plain(DiveHistory, json.loads(json.dumps(plain(faded), allow_nan=False))) == faded


def test_the_page_over_many_dives_stands_alone(faded, paper):
    """It refers to nothing but the reports beside it, has every section once, and its pictures are sound XML."""
    page = dives_page(faded, paper)
    addresses = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert set(addresses) == {"data:,", "dives/009_dive_9/report.html"}
    assert "url(" not in page and "@import" not in page and "<script" not in page
    ids = re.findall(r' id="(\w+)"', page)
    assert len(ids) == len(set(ids))
    assert set(ids) >= SECTIONS
    pictures = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
    assert len(pictures) == 2 + len(faded.numbers)
    for picture in pictures:
        assert ElementTree.fromstring(picture).attrib["aria-label"]


def test_the_page_over_many_dives_says_what_was_found(faded, paper):
    """Summary, alarm, change, rate and advice are there, and the thruster is marked."""
    page = dives_page(faded, paper)
    words = [faded.summary, faded.alarms[0].sentence, "one alarm in 1000 dives", "Thruster 3 is weak.", "look for weed"]
    for text in words:
        assert text in page
    assert set(re.findall(r'<text class="thruster bad number"[^>]*>([^<]+)<', page)) == {"3"}
    assert 'class="alarm"' in page and 'class="curve shift"' in page


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
@pytest.mark.parametrize("width", [1200, 1000])
def test_a_long_unit_cuts_off_no_column(faded, paper, tmp_path, width):
    """In a window of a usual width the table of a change fits into its card."""
    probe = """<script>
      const tables = [...document.querySelectorAll("#changes .scroll")];
      document.documentElement.dataset.cut = tables.filter(e => e.scrollWidth > e.clientWidth).length;
    </script></body>"""
    wordy = replace(faded, numbers=tuple(replace(number, unit="kg/s, kg m/s") for number in faded.numbers))
    page = tmp_path / "dives.html"
    page.write_text(dives_page(wordy, paper).replace("</body>", probe), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
    command = [str(CHROMIUM), *options, f"--window-size={width},900", "--dump-dom", page.as_uri()]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert 'data-cut="0"' in shown


def test_a_page_where_nothing_changed_says_so(paper):
    """Sound dives have a page without an alarm, an odd one among them is pointed at, and names are shown, not run."""
    names = [f"<script>{i}</script>.csv" for i in range(12)]
    dives = dives_of(np.zeros((12, 5)), names=names)
    history = history_of(dives)
    page = dives_page(history, paper)
    assert "Nothing changed over 12 dives." in page
    assert "<script" not in page
    assert "as it was" in page
    odd = history_of([replace(dive, excess=4.0) if i == 6 else dive for i, dive in enumerate(dives)])
    assert "Dive 7 shows something that is none of the numbers followed." in dives_page(odd, paper)
