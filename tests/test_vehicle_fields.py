"""The table of vehicle parameters: class, reader, writer, checks and coefficients agree with it, entry by entry."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
import yaml

from auv_torchrl.paths import PROJECT, config_names, config_path
from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import load_vehicle
from auv_torchrl.vehicle.changed_file import described, entries, fold
from auv_torchrl.vehicle.fields import BY_LABEL, FIELD_OF, OLDER, VEHICLE_FIELDS, label, may_be_left_out
from tests.entries import with_entry

NOT_IN_A_WRENCH = {"mixer"}  # the autopilot reads it, no equation of motion
NEW_ENTRY = """
import json, sys
from types import ModuleType
from pathlib import Path

path = Path("auv_torchrl/vehicle/fields.py")
entry = '''    "ballast": Field(
        (3,), "kg", "mass at bow, middle and stern", "rigid_body", default=0.0, given=In("[0, inf)"),
        usual=In("[0, 5]", "kg"), mistaken={"g": 1e-3}, brief=True, later=True,
    ),
'''
source = path.read_text()
assert source.count("    # water\\n") == 1
module = sys.modules["auv_torchrl.vehicle.fields"] = ModuleType("auv_torchrl.vehicle.fields")
exec(compile(source.replace("    # water\\n", entry + "    # water\\n"), path, "exec"), module.__dict__)

from auv_torchrl.physics import prepare
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file, vehicle_doubts
from auv_torchrl.vehicle.changed_file import described, entries, fold, section_lines


def loaded(**ballast):
    content = dict(read_vehicle_file("paper"))
    return load_vehicle(content | {"rigid_body": dict(content["rigid_body"], **ballast)})


def refusal(value):
    try:
        loaded(ballast=value)
    except ValueError as error:
        return str(error)


given = loaded(ballast=[1.0, 0.0, 2.0])
written = entries(fold(given), "mine")
print(json.dumps({
    "read": given.ballast.tolist(),
    "left out": loaded().ballast.tolist(),
    "coefficient": prepare(given.expand(2)).ballast.tolist(),
    "written": written["rigid_body"]["ballast"],
    "line": [line for line in section_lines("rigid_body", written["rigid_body"]) if "ballast" in line],
    "read again": load_vehicle(written).ballast.tolist(),
    "hashed": ["ballast" in described(given), "ballast" in described(loaded())],
    "negative": refusal([-1.0, 0.0, 0.0]),
    "short": refusal([1.0]),
    "doubts": [doubt for doubt in vehicle_doubts(loaded(ballast=[800.0, 0.0, 0.0])) if "ballast" in doubt],
}))
"""


def paper():
    return {"sensors": {}, "fins": {}, "servos": {}, **yaml.safe_load(config_path("vehicle", "paper").read_text())}


def other_value(name):
    """Another possible value of an entry than the paper's vehicle has, near by, as a file says it."""
    value = load_vehicle("paper").get(name)
    kind = VEHICLE_FIELDS[name]
    if name == "turns":  # a number of the list: the vertical thruster stands for a servo
        return [0, 0, 0, 0, 1, 0]
    # A tenth down keeps an air of 1 and a dead band below the thrust; nothing moves up or down from zero.
    changed = np.where(value == 0, 0.01, 0.9 * value)
    if kind.square:
        return changed.diagonal().tolist()
    return changed.flatten()[0].item() if kind.each else changed.tolist()


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_a_vehicle_has_the_parameters_of_the_table_in_their_shapes(name):
    """No more, no fewer, also in a batch."""
    vehicle = load_vehicle(name)
    shapes = {key: kind.shape_of(vehicle.thrusters) for key, kind in VEHICLE_FIELDS.items()}
    assert {key: tuple(value.shape) for key, value in vehicle.items()} == shapes
    assert {key: tuple(value.shape[1:]) for key, value in vehicle.expand(3).items()} == shapes


@pytest.mark.parametrize("entry", FIELD_OF)
def test_what_a_file_says_is_read_into_its_parameter_and_written_back(entry):
    """Another value changes that parameter alone, and the file that is written says so."""
    name, before = FIELD_OF[entry], load_vehicle("paper")
    value = other_value(name)
    after = load_vehicle(with_entry(paper(), entry.split("."), value))
    assert {key for key, was in before.items() if not np.array_equal(was, after.get(key))} <= {name}
    written = entries(fold(after), "mine")
    for part in entry.split("."):
        written = written[part]
    read = load_vehicle(with_entry(paper(), entry.split("."), written))
    np.testing.assert_allclose(read.get(name), after.get(name), rtol=1e-7, atol=1e-12)
    if name != "thruster_direction":  # only its direction counts
        assert not np.array_equal(before.get(name), after.get(name))
        assert after.get(name).flat[0] == pytest.approx(np.ravel(value)[0], rel=1e-7)


@pytest.mark.parametrize("entry", [entry for entry, kind in BY_LABEL.items() if -1e9 not in kind.given])
def test_what_is_impossible_of_an_entry_is_refused_by_its_name(entry):
    """A billion below zero, where that is out of its bounds."""
    kind = BY_LABEL[entry]
    value = -1e9 if not kind.length else [-1e9] * kind.length
    value = [value] * load_vehicle("paper").thrusters if kind.rows else value
    with pytest.raises(ValueError, match=rf"{entry} is .*: give values"):
        load_vehicle(with_entry(paper(), entry.split("."), value))


@pytest.mark.parametrize(("older", "entry"), OLDER.items())
def test_older_files_have_entries_elsewhere(older, entry):
    """They are read alike, may be given on the command line, and one that is said twice is refused."""
    was, now = (load_vehicle(with_entry(paper(), name.split("."), 0.3)) for name in (older, entry))
    assert all(np.array_equal(value, now.get(key)) for key, value in was.items())
    assert may_be_left_out(f"vehicle.{older}") and may_be_left_out(f"vehicle.{entry}")
    with pytest.raises(ValueError, match=f"{entry} is given as {older}, too: give it in section servos alone"):
        load_vehicle(with_entry(with_entry(paper(), older.split("."), 0.3), entry.split("."), 0.3))


@pytest.mark.parametrize("entry", BY_LABEL)
def test_an_entry_may_be_left_out_where_the_table_has_a_default(entry):
    """Then the parameter has the default; else the entry is missed by its name."""
    kind, name = BY_LABEL[entry], FIELD_OF[entry]
    content = with_entry(paper(), entry.split("."), 0.0)  # so that there is one to leave out
    content = with_entry(content, entry.split("."), ...)
    assert may_be_left_out(f"vehicle.{entry}") is (kind.default is not ...)
    if kind.default is ...:
        with pytest.raises(ValueError, match=rf"{entry}.* missing"):
            load_vehicle(content)
    else:
        assert (load_vehicle(content).get(name) == kind.default).all()


def test_what_no_file_says_is_nominal():
    """The identity on the diagonal of a matrix, the default anywhere else."""
    vehicle = load_vehicle("paper")
    for name, kind in VEHICLE_FIELDS.items():
        if kind.section is None:
            value = vehicle.get(name)
            assert kind.default is not ..., name
            due = np.eye(len(value)) if kind.square else kind.default
            assert (value == due).all(), name


@pytest.mark.parametrize("name", VEHICLE_FIELDS)
def test_every_parameter_reaches_the_coefficients(name):
    """As it is where the table says so; else another value changes what is worked out of several."""
    loaded = {"payload_mass": np.ones(2), "payload_weight": np.ones(2)}  # so that its place counts
    vehicle = load_vehicle("paper").expand(2).replace(**loaded)
    before = prepare(vehicle)
    if VEHICLE_FIELDS[name].copied:
        assert np.array_equal(getattr(before, name), vehicle.get(name))
        return
    value = vehicle.get(name)
    after = prepare(vehicle.replace(**{name: np.where(value == 0, 0.1, 0.9 * value)}))
    differs = any(not np.array_equal(one, other) for one, other in zip(before, after, strict=True))
    assert differs is (name not in NOT_IN_A_WRENCH)


def test_labels_are_those_of_sections_and_no_parameter_is_named_twice():
    """Every entry of a file stands for one parameter, and every parameter with a section has an entry."""
    in_files = {name: kind for name, kind in VEHICLE_FIELDS.items() if kind.section is not None}
    labels = [label(kind.section or "", kind.entry or name) for name, kind in in_files.items()]
    assert sorted(labels) == sorted(FIELD_OF) and len(set(FIELD_OF.values())) == len(FIELD_OF)


def test_a_parameter_is_left_out_of_hashes_only_where_it_is_nothing_without_an_entry():
    """Results that are kept under a hash are found again by vehicles which do not have it."""
    vehicle = load_vehicle("paper")
    later = {name for name, kind in VEHICLE_FIELDS.items() if kind.later}
    assert all(VEHICLE_FIELDS[name].default is not ... for name in later)
    assert set(described(vehicle)) == set(VEHICLE_FIELDS) - later
    for name in later:
        other = vehicle.replace(**{name: vehicle.get(name) + 0.1})
        assert set(described(other)) - set(described(vehicle)) == {name}


def test_a_new_parameter_is_one_entry_of_the_table():
    """Class, reader, writer, checks and coefficients have it, and nothing else was changed."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", NEW_ENTRY], capture_output=True, text=True, cwd=PROJECT, env=environment
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout.splitlines()[-1])
    assert found["read"] == found["written"] == found["read again"] == [1.0, 0.0, 2.0]
    assert found["left out"] == [0.0] * 3
    assert found["coefficient"] == [[1.0, 0.0, 2.0]] * 2
    assert found["line"] == ["  ballast: [1, 0, 2]  # kg"]
    assert found["hashed"] == [True, False]
    assert "rigid_body.ballast is [-1.0, 0.0, 0.0]: give values" in found["negative"]
    assert "rigid_body.ballast is [1.0]: give 3 numbers" in found["short"]
    (doubt,) = found["doubts"]
    assert "usual: 0 to 5 kg" in doubt and "rigid_body.ballast looks like g, give kg" in doubt
