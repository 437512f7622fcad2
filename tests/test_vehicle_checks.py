"""Numbers of a vehicle file that cannot be, or hardly can: they are named, with the unit that they look like."""

import logging
import re

import numpy as np
import pytest

from auv_torchrl.paths import PROJECT, config_names
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from auv_torchrl.vehicle.fields import BY_LABEL
from tests.entries import with_entry

FILLED = {  # what a bluerov2 leaves out, or has as 0
    "rigid_body.hull_height": 0.25,
    "drag_asymmetry": [0.1] * 6,
    "mass_scale": [1.1] * 6,
    "surface": -1.5,
    "air": 1.0,
    "thrusters.reaction": 0.016,
    "thrusters.lag": 0.1,
    "fins": {"stall": 0.4},
    "servos": {"offset": 0.1},
    "thrusters.delay": 0.05,
    "rigid_body.centre_of_buoyancy": [0.0, 0.0, -0.03],
    "sensors": {
        "heading_bias": 0.1, "pose_delay": 0.1, "position_scale": 1.02, "depth_scale": 1.02, "velocity_scale": 0.98,
        "depth_bias": 0.1, "dvl_position": [0.1, 0.0, 0.1], "dvl_turn": 0.785,
        "accelerometer_position": [0.1, 0.0, 0.0], "accelerometer_bias": [0.1, 0.05, -0.1],
    },
}  # fmt: skip
UP = "m with z pointing up"
MISTAKES = [(name, unit) for name, kind in BY_LABEL.items() for unit in kind.mistaken]


def bluerov2(**entries):
    """Its file with other entries, by label with __ for the dot."""
    content = dict(read_vehicle_file("bluerov2"))
    for name, value in entries.items():
        content = with_entry(content, name.split("__"), value)
    return content


def filled():
    return bluerov2(**{name.replace(".", "__"): value for name, value in FILLED.items()})


def said_of(content, caplog):
    """The error or the warnings that loading leaves."""
    caplog.clear()
    with caplog.at_level(logging.WARNING, logger="auv_torchrl"):
        try:
            load_vehicle(content)
        except ValueError as error:
            return [str(error)]
    return [record.getMessage() for record in caplog.records]


@pytest.mark.parametrize("name", [*config_names("vehicle"), str(PROJECT / "benchmarks/real/haizhe.yaml")])
def test_the_shipped_vehicles_are_plausible(name, caplog):
    """None of them leaves a warning."""
    assert not said_of(name, caplog)


def test_a_vehicle_that_says_everything_is_plausible(caplog):
    """Entries that may be left out have ordinary values without a warning."""
    assert not said_of(filled(), caplog)


@pytest.mark.parametrize(("name", "unit"), MISTAKES, ids=[f"{name} in {unit}" for name, unit in MISTAKES])
def test_a_number_in_another_unit_is_named_with_the_unit_that_it_looks_like(name, unit, caplog):
    """Every entry of the table, in every unit that people mistake it in."""
    content, path = filled(), name.split(".")
    if unit == UP:  # shows where it turns the vehicle over
        content = with_entry(content, ["rigid_body", "centre_of_mass" if "buoyancy" in name else "centre_of_buoyancy"],
                             [0.0, 0.0, 0.0])  # fmt: skip
    value = content
    for part in path:
        value = value[part]
    wrong = np.asarray(value, dtype=float) / np.asarray(BY_LABEL[name].mistaken[unit])
    said = said_of(with_entry(content, path, wrong.tolist()), caplog)
    assert any(name in sentence and f"like {unit}" in sentence for sentence in said), said


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"rigid_body__inertia": [0.1, 0.1, 0.3]}, "inertia is 1.5 times the sum of the others, which no body"),
        ({"thrusters__dead_band": 60.0}, "dead band is 1.17 times the largest thrust, so that a thruster never pushes"),
        ({"thrusters__limit": [51.5] * 5 + [0.9]}, "dead band is 1.06 times the largest thrust"),
        ({"thrusters__lag": 100.0}, "thrusters.lag is 100.0: .*looks like ms"),
        ({"thrusters__delay": 100.0}, "thrusters.delay is 100.0: .*looks like ms"),
        ({"thrusters__direction": [[-135, 45, 0]] * 6}, r"thrusters.direction is .*: give values of -10 or more"),
        ({"mixer": [[0] * 6] * 6}, "the largest number of the mixer is 0, so that no command reaches a thruster"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(entries, message):
    """An impossible number, or several that are impossible beside each other."""
    with pytest.raises(ValueError, match=message):
        load_vehicle(bluerov2(**entries))


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        (
            {"servos__turns": [0, 0, 1, 5]},
            r"has 5 for number 4: give the number of a thruster that pushes \(\[1, 2\]\)",
        ),
        ({"servos__turns": [0, 0, 1, 3]}, "has 3 for number 4: give the number of a thruster that pushes"),
        ({"servos__turns": [0, 0, 1.5, 2]}, "has 1.5 for number 3: give the number of a thruster that pushes"),
        ({"servos__turns": [0, 0, 1, 1]}, "has 1 for numbers 3 and 4: a thruster has one servo"),
        ({"servos__turns": 1}, r"servos.turns has 1 for number 1: .* that pushes \(\[\]\), or 0"),
        ({"servos__turns": [0, 0, -1, 2]}, "servos.turns is .*: give values of 0 or more"),
        ({"servos__turns": [0, 0, 1]}, "servos.turns is .*: give one number, or 4, one per thruster"),
        ({"servos__turns": "both"}, "servos.turns is 'both': give one number"),
        ({"fins": {"area": [0, 0, 0.1, 0]}}, "has 1 for number 3, which is a fin: give 0 there, or fins.area 0"),
        (
            {"thrusters__direction": [[1, 0, 0], [1, 0, 0], [1, 0, 0.1], [0, 0, 1]]},
            "thruster 1 pushes by 1 of its thrust",
        ),
        ({"servos": [1, 2]}, r"servos is \[1, 2\]: give a mapping with turns, rate, offset"),
        ({"servos__reach": 1.0}, r"unknown entries \['reach'\] in servos"),
        ({"servos__rate": -1.0}, "servos.rate is -1.0: give values of 0 or more"),
    ],
)
def test_servos_that_cannot_be_are_refused(entries, message):
    """A servo turns one thruster that pushes across its axis, and no thruster has two."""
    content = dict(read_vehicle_file("milliampere"))
    for name, value in entries.items():
        content = with_entry(content, name.split("__"), value)
    with pytest.raises(ValueError, match=message):
        load_vehicle(content)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"rigid_body__buoyancy": 11.7}, "the weight is 9.64 times the buoyancy .*buoyancy looks like kg, give N"),
        ({"rigid_body__buoyancy": 1148.0}, "the weight is 0.0983 times the buoyancy .*check rigid_body.buoyancy and"),
        ({"rigid_body__centre_of_buoyancy": [0, 0, 0.05]}, "above the centre of mass, below 0 it capsizes"),
        ({"thrusters__position": [[156, 111, 0]] + [[0.1, 0.1, 0]] * 5}, "thruster is 843 times .*looks like mm"),
        ({"linear_drag": [0] * 6, "quadratic_drag": [0] * 6}, "so that it hardly stops"),
        ({"mixer": [[0] * 6, *[[1, 1, 1, 0, 0, 1]] * 5]}, "so that a thruster is never commanded"),
        ({"rigid_body__buoyancy": 1e300}, "check rigid_body.buoyancy and rigid_body.mass"),
    ],
)
def test_what_hardly_can_be_is_a_warning(entries, message, caplog):
    """The vehicle is loaded, and the warning names the entry."""
    said = said_of(bluerov2(**entries), caplog)
    assert any(re.search(message, sentence) for sentence in said), said


def test_numbers_that_share_a_mistaken_unit_are_named_together(caplog):
    """Full thrust and limit in kgf stand in their usual proportion: neither alone puts it right."""
    (said,) = said_of(bluerov2(thrusters__full_thrust=5.25, thrusters__limit=5.25, thrusters__dead_band=0.1), caplog)
    assert "thrusters.full_thrust and thrusters.limit look like kgf, give N" in said


def test_a_warning_names_the_file(tmp_path, caplog):
    """A vehicle may be read from anywhere."""
    path = tmp_path / "mine.yaml"
    path.write_text((PROJECT / "conf/vehicle/bluerov2.yaml").read_text().replace("delay: 0.0 ", "delay: 13.0 "))
    (said,) = said_of(path, caplog)
    assert said == f"{path}: vehicle: thrusters.delay is 13 (usual: 0 to 2 s): thrusters.delay looks like ms, give s"
