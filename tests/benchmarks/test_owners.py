"""What owners' vehicles do: drawn, flown, sealed, and scored by what an answer says."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.flightlog import raw_columns, read_flightlog
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import HEALTHY
from benchmarks.blind.flights.damages import damaged
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.flights.sensor_sets import SENSOR_SETS
from benchmarks.blind.seal import log_path, open_labels, read_manifest, seal
from benchmarks.owners import __main__ as owners
from benchmarks.owners.acts import ACTS, OneThruster, OneWay, Replugged
from benchmarks.owners.cases import (
    ELSE,
    FAMILIES,
    FILES,
    LOOSE,
    SENSOR,
    SOUND,
    THRUSTER,
    WIRING,
    draw_owner_cases,
    file_of,
)
from benchmarks.owners.score import owner_tables, score_owner
from benchmarks.owners.still import kinds

VEHICLE = load_vehicle("bluerov2_heavy")
COMMANDS = np.linspace(-1.0, 1.0, 21)[:, None] * np.ones(8)  # rows are commands, all thrusters alike


def effect(name, thrusters=(), probability=0.9, calibrates=False, closed=0.9, **values):
    """An effect as an answer has it."""
    numbers = {key: {"value": value, "nominal": 1.0} for key, value in values.items()}
    given = {"probability": probability, "calibrates": calibrates, "gap_closed": closed}
    return {"name": name, "thrusters": list(thrusters), "parameters": numbers, **given}


def answer(*effects, verdict="explained", findings=(), thruster=None):
    """An answer of these effects."""
    said = {"verdict": verdict, "effects": list(effects), "findings": list(findings), "headline": "so it is"}
    return {"diagnosis": {**said, "where": {"thruster": thruster or {}}, "indistinguishable": []}, "cpu_s": 1.0}


def label(family, **more):
    """A label of a family."""
    common = {"family": family, "outside": "one_way", "damage": None, "stranger": None, "slack": 0.0}
    return {**common, "drawn": {"thruster": 3}, "named_by": None, **more}


@pytest.mark.parametrize("sensors", SENSOR_SETS)
def test_families_and_files_take_turns(sensors):
    """Of 36 cases, two are of each family and file, the same ones for a seed; a wrong file has two flights."""
    cases = draw_owner_cases(sensors, 36, 4)
    assert cases == draw_owner_cases(sensors, 36, 4)
    asked = [case for case in cases if case.family != HEALTHY]
    turns = Counter((case.family, file_of(case.stranger, case.slack)) for case in asked)
    assert turns == {(family, file): 2 for family in FAMILIES for file in FILES}
    assert len(cases) - len(asked) == 2 * sum(case.stranger is not None for case in asked)
    assert {case.damage for case in asked if case.family == SENSOR} <= set(kinds(sensors))


@pytest.mark.parametrize("name", ACTS)
def test_one_act_changes_what_it_says(name):
    """An act on one thruster leaves all others; exchanged plugs send each command somewhere, turned round or not."""
    act = ACTS[name](np.random.default_rng(3), len(COMMANDS), 8, CONTROL_DT)
    commands = COMMANDS * np.linspace(0.3, 1.0, 8)
    after = act.received(commands)
    if isinstance(act, OneThruster):
        others = np.arange(8) != act.which
        assert np.array_equal(after[:, others], commands[:, others]) and act.drawn()["thruster"] == act.which + 1
    else:
        giver, sign = np.array(act.drawn()["giver"]) - 1, np.ones(8)
        sign[np.array(act.drawn()["backwards"], int) - 1] = -1
        assert np.array_equal(after, sign * commands[:, giver]) and not np.array_equal(after, commands)


def test_a_one_way_thruster_pushes_one_way():
    """Commands of one sign pass, those of the other become rest."""
    act = OneWay(np.random.default_rng(0), len(COMMANDS), 8, CONTROL_DT)
    mine = act.received(COMMANDS)[:, act.which]
    assert (act.way * mine >= 0).all() and np.abs(mine).max() == 1.0 and (mine == 0).sum() >= 10


def test_exchanged_plugs_are_a_permutation():
    """Whatever is drawn, each command reaches one thruster."""
    for seed in range(50):
        act = Replugged(np.random.default_rng(seed), 2, 8, CONTROL_DT)
        assert sorted(act.drawn()["giver"]) == list(range(1, 9))


@pytest.fixture(scope="module")
def columns():
    """The columns of two sealed cases by sensors: what was flown and measured."""
    found = {}
    for sensors in SENSOR_SETS:
        (one,) = [case for case in draw_owner_cases(sensors, 4, 2) if case.family == SENSOR]
        ((log, _),) = fly([replace(one, episodes=2, episode_s=10.0)], VEHICLE, 2, ACTS)
        found[sensors] = raw_columns(log)
    return found


@pytest.mark.parametrize(("sensors", "name"), [(sensors, name) for sensors in SENSOR_SETS for name in kinds(sensors)])
def test_channels_that_do_not_follow_are_false_and_no_others(columns, sensors, name):
    """What stands still or is replayed is what the label says, all along or to the end, and is as noisy as it was."""
    flown, damage = columns[sensors], kinds(sensors)[name]
    log, false = damaged(flown, damage, np.random.default_rng(5))
    changed = {axis for axis in flown if not np.array_equal(flown[axis], log[axis])}
    assert changed == set(false) == set(damage.axes) & set(flown) and log[false[0]][-1] != flown[false[0]][-1]


def test_a_sealed_folder_says_what_was_drawn_and_hands_over_no_truth(tmp_path):
    """The labels have thruster and share; the tasks have the healthy flights of a wrong file, and nothing else."""
    drawn = draw_owner_cases("mocap", 18, 1)
    few = [case for case in drawn if case.family != HEALTHY][13:15]
    mine = [case for case in drawn if case.family == HEALTHY and case.stranger in {one.stranger for one in few}]
    short = [replace(case, episodes=2, episode_s=10.0) for case in (*few, *mine)]
    seal(tmp_path, {"sensors": "mocap"}, fly(short, VEHICLE, 1, ACTS), kinds("mocap"))
    labels, tasks = open_labels(tmp_path), read_manifest(tmp_path)["tasks"]
    assert set(labels) == set(tasks) and all(len(task["healthy"]) == 2 for task in tasks.values())
    assert labels[few[0].name]["drawn"]["thruster"] in range(1, 9) and "giver" in labels[few[1].name]["drawn"]
    log = read_flightlog(log_path(tmp_path, few[0].name), VEHICLE)
    assert len(log.episodes) == 2


@pytest.mark.parametrize(
    ("given", "said", "right"),
    [
        (label(THRUSTER), answer(effect("reverse_gain", [3])), True),
        (label(THRUSTER), answer(effect("reverse_gain", [3]), effect("thruster_gain", [5])), False),
        (label(THRUSTER), answer(effect("reverse_gain", [3]), effect("thruster_gain", [5], 0.4)), True),
        (label(THRUSTER), answer(effect("reverse_gain", [3]), effect("linear_drag", calibrates=True)), True),
        (label(THRUSTER), answer(verdict="no_gap"), False),
        (label(SOUND), answer(verdict="no_gap"), True),
        (label(SOUND), answer(effect("hull", calibrates=True)), True),
        (label(SOUND), answer(effect("hull", calibrates=True), verdict="partly_explained"), False),
        (label(SOUND), answer(effect("reverse_gain", [3])), False),
        (label(LOOSE), answer(effect("thruster_gain", [3])), True),
        (label(ELSE), answer(verdict="unexplained", thruster={"3": 0.7, "1": 0.2}), True),
        (label(ELSE), answer(verdict="unexplained", thruster={"3": 0.1, "1": 0.2}), False),
        (label(SENSOR, named_by={"columns": ["z"], "codes": ["frozen"]}), answer(verdict="cannot_tell"), False),
        (
            label(SENSOR, named_by={"columns": ["z"], "codes": ["frozen"]}),
            answer(verdict="cannot_tell", findings=[{"code": "frozen", "columns": ["z"]}]),
            True,
        ),
    ],
)
def test_an_answer_is_right_where_it_names_the_thruster_or_the_channel_alone(given, said, right):
    """Names that are likelier than not are claims; corrections of the file are none."""
    assert score_owner("case_0001", given, said, VEHICLE).right is right


def test_wiring_is_right_only_where_it_is_exact():
    """Each thruster has its command and its sign, and no other sign is turned."""
    drawn = {"giver": [2, 1, 3, 4, 5, 6, 7, 8], "backwards": [5]}
    swapped, turned = (
        effect("thruster_swap", [1, 2], command_1=2.0, command_2=1.0),
        effect("thruster_gain", [5], gain_5=-0.9),
    )
    wires = effect("thruster_swap", [1, 2, 5], command_1=2.0, command_2=1.0, command_5=-5.0)
    both = (wires, True), (effect("thruster_swap", [5], command_5=-5.0), False)
    for said, right in (
        ((swapped, turned), True),
        ((swapped,), False),
        ((turned,), False),
        *(((a,), b) for a, b in both),
    ):
        found = score_owner("case_0001", label(WIRING, drawn=drawn), answer(*said), VEHICLE)
        assert found.right is right


def test_a_refused_log_and_a_failed_diagnosis_are_rows_like_others():
    """Both have no names; their sentence stands in the table of what fails."""
    for silent in ({"refused": "no log", "cpu_s": 1.0}, {"error": "ValueError: no", "cpu_s": 1.0}):
        found = score_owner("case_0001", label(THRUSTER), silent, VEHICLE)
        assert not found.right and found.headline and found.case in str(owner_tables([found], "stock")[-1])


def test_the_command_says_what_it_expects(monkeypatch, capsys):
    """Numbers that make no benchmark are refused in one line."""
    monkeypatch.setattr("sys.argv", ["owners", "stock", "--cases", "0"])
    with pytest.raises(SystemExit):
        owners.main()
    assert "--cases and --workers are 1 or more" in capsys.readouterr().err
