"""The whole benchmark, small."""

import json
from importlib import import_module
from operator import attrgetter

import pytest

from auv_torchrl.diagnosis import thresholds
from auv_torchrl.diagnosis.identify import explanation
from auv_torchrl.diagnosis.identify.search import _EffectSearch
from benchmarks.blind.ablation import OFF, ablate
from benchmarks.blind.examine import examine
from benchmarks.blind.flights.cases import FAMILIES
from benchmarks.blind.without import PARTS, Part, always, cases_of, changed_without, watch
from tests.command_lines import answers_of

OTHERS = [f"families.{family}=0" for family in FAMILIES if family not in ("single", "no_gap")]
SET_OTHERS = [f"set_families.{family}=0" for family in ("load", "depth_bias", "no_gap_slack")]
SMALL = {
    "main": ["cases=2", "workers=1", "seed=3", *OTHERS],  # a fault of clear size, and none
    "mocap": ["cases=1", "workers=1", "sensors=mocap", "set_families.no_gap=0", *SET_OTHERS],
}
BAD = {  # command line, what the answer names
    "other cases": (["cases=6"], "choose another folder"),
    "misspelt family": (["families.singel=1"], "did you mean single"),
    "no case": (["cases=0"], "1 or more"),
    "two parts at once": (["sensors=dvl", "strangers=2"], "set one of them to null"),
    "no such sensors": (["sensors=sonar"], "stock or dvl or mocap"),
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """What the program answers to all command lines, each in a folder of its own, and these folders, by name."""
    overrides = SMALL | {name: line for name, (line, _) in BAD.items()}
    folders = {name: tmp_path_factory.mktemp("blind") for name in overrides}
    manifest = {"settings": {"cases": 5, "seed": 0, "families": {}}, "labels_sha256": "", "tasks": {}}
    (folders["other cases"] / "manifest.json").write_text(json.dumps(manifest))
    lines = {name: [*line, f"folder={folders[name]}"] for name, line in overrides.items()}
    told = answers_of("benchmarks.blind.__main__", {**lines, "help": ["--help"]})
    return {name: (answer, folders.get(name)) for name, answer in told.items()}


def test_help_of_a_command_without_a_text_of_its_own_is_its_file(runs):
    """The benchmark explains its settings in comments, and ``--help`` shows these."""
    (code, said, _), _ = runs["help"]
    assert code == 0 and "make blind CASES=430" in said and "strangers: null" in said


def answers_in(folder):
    """Where the answers of a benchmark are."""
    return next(folder.rglob("diagnosis_*"))


@pytest.mark.slow
def test_sealed_cases_are_flown_diagnosed_and_scored(runs):
    """No diagnosis crashes, all are right, the report is written, and a killed run goes on where it was."""
    (code, out, err), folder = runs["main"]
    assert code == 0, err
    answers = answers_in(folder)
    assert "single effect named first" in out
    results = json.loads((answers / "results.json").read_text())
    assert len(results) == 2
    assert not [r["message"] for r in results if r["message"]]
    assert all(r["right"] for r in results)
    assert (answers / "confusion.png").exists() and "Cases that fail" in (answers / "results.md").read_text()

    given = {path: path.stat().st_mtime_ns for path in answers.glob("case_*.json")}
    (quickest,) = (r["case"] for r in results if r["truth"] == "no_gap")
    lost = answers / f"{quickest}.json"
    before = json.loads(lost.read_text())["diagnosis"]
    lost.unlink()
    examine(answers.parent, answers, workers=1)
    assert json.loads(lost.read_text())["diagnosis"] == before
    assert all(path.stat().st_mtime_ns == then for path, then in given.items() if path != lost)


@pytest.mark.slow
@pytest.mark.thorough
def test_a_threshold_that_decides_moves_an_answer(runs):
    """Where one more effect must bring a million times the evidence, the fault that was found is found no more."""
    answers = answers_in(runs["main"][1])
    results = json.loads((answers / "results.json").read_text())
    fault = next(r["case"] for r in results if r["truth"] != "no_gap" and r["verdict"] == "explained")
    cases = [(answers.parent, fault)]
    same = {"WORTH_AN_EFFECT": thresholds.WORTH_AN_EFFECT}
    found = ablate(cases, {"same": same, "more": {"WORTH_AN_EFFECT": 5e6}}, "small", 1)
    assert set(found) == {"more"}
    moved = found["more"]
    assert moved.startswith(f"{answers.parent.name}/{fault}: explained (")
    assert "-> explained" not in moved


def test_what_the_ablation_switches_off_is_a_threshold():
    """A threshold that is renamed or gone is not left among those that the ablation switches off."""
    assert set(OFF) <= set(vars(thresholds))


@pytest.mark.parametrize("name", PARTS)
def test_what_is_left_out_is_a_part_of_the_diagnosis(name, monkeypatch):
    """A function that is renamed or gone is not left among the parts that are left out one at a time."""
    for place in PARTS[name].places:
        module, _, path = place.partition(":")
        assert callable(attrgetter(path)(import_module(f"auv_torchrl.diagnosis.{module}")))


@pytest.mark.thorough
@pytest.mark.slow
def test_an_answer_that_changes_without_a_part_is_counted(runs, monkeypatch):
    """A search in which every effect is small names none: the answer to a fault changes, and is counted."""
    _, folder = runs["main"]
    part = Part("all effects are small", ("identify.search:_EffectSearch.is_small",), always(True))
    monkeypatch.setitem(PARTS, "all_small", part)
    monkeypatch.setattr(_EffectSearch, "is_small", _EffectSearch.is_small)  # is put back afterwards
    answers = answers_in(folder)
    results = {r["case"]: r["truth"] for r in json.loads((answers / "results.json").read_text())}
    cases = [case for case in cases_of([answers.parent], 3) if results[case[1]] != "no_gap"]
    took = {case: json.loads((answers / f"{case[1]}.json").read_text())["cpu_s"] for case in cases}
    quickest = min(cases, key=took.__getitem__)
    (changed,) = changed_without("all_small", [quickest])
    assert changed.startswith(f"{answers.parent.name}/{quickest[1]}: explained (")


def test_a_part_that_is_watched_acts_where_it_gives_something_else(monkeypatch):
    """What gives the same as what stands for it cannot change an answer, nor can one that is never called."""
    for name in ("exchanges", "derangements"):
        monkeypatch.setattr(explanation, name, getattr(explanation, name))  # is put back afterwards
    place = ("identify.explanation:exchanges",)
    acting = watch({
        "other": Part("gives another", place, always(0)),
        "same": Part("gives the same", place, always(1)),
        "slow": Part("is not asked what it gives", place, always(1), is_slow=True),
        "never": Part("is not called", ("identify.explanation:derangements",), always(0)),
    })  # fmt: skip
    assert explanation.exchanges({1: 2, 2: 1}) == 1
    assert acting == {"other", "slow"}


@pytest.mark.slow
def test_a_set_of_sensors_is_flown_diagnosed_and_scored(runs):
    """A fault before cameras: a folder of its own, a table of its own, and named."""
    (code, out, err), folder = runs["mocap"]
    assert code == 0, err
    answers = answers_in(folder)
    assert "Sensors: mocap" in out and answers.parent.name == "mocap"
    results = json.loads((answers / "results.json").read_text())
    assert [r["message"] for r in results if r["message"]] == []
    assert [r["right"] for r in results] == [True]
    assert "What these sensors can show" in (answers / "results.md").read_text()


@pytest.mark.parametrize("bad", BAD)
def test_bad_settings_are_refused(runs, bad):
    """Other settings than those of the folder, a misspelt family, an impossible number: errors of one line."""
    (code, _, error), _ = runs[bad]
    assert code == 2, error
    assert BAD[bad][1] in error and "Traceback" not in error
