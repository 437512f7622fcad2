"""Vehicle files: what is read, and that mistakes are named."""

import math

import numpy as np
import pytest
import yaml

from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import config_names, config_path
from auv_torchrl.physics.coefficients import total_mass_matrix
from auv_torchrl.vehicle import CONTROLLED_INDEX, Vehicle, load_vehicle
from tests.entries import with_entry
from tests.hovering import HOVERING


def paper():
    return yaml.safe_load(config_path("vehicle", "paper").read_text())


@pytest.mark.parametrize("name", config_names("vehicle"))
def test_every_file_can_be_loaded(name):
    """Every vehicle of the folder has finite parameters, unit directions and a name like its file."""
    vehicle = load_vehicle(name)
    assert isinstance(vehicle, Vehicle) and vehicle.batch_size == ()
    for key, value in vehicle.items():
        assert np.isfinite(value).all(), key
    np.testing.assert_allclose(np.linalg.norm(vehicle.thruster_direction, axis=-1), 1.0, rtol=1e-12)
    assert yaml.safe_load(config_path("vehicle", name).read_text())["name"] == name


@pytest.mark.parametrize("name", HOVERING)
def test_the_mixer_moves_what_it_names(name):
    """Demand in surge, sway, heave or yaw gives a wrench in that degree of freedom, positive, and little else."""
    vehicle = load_vehicle(name)
    direction, position = vehicle.thruster_direction, vehicle.thruster_position
    allocation = np.concatenate((direction, np.cross(position, direction)), axis=-1).T
    wrench = allocation @ vehicle.mixer
    for index in CONTROLLED_INDEX:
        own = wrench[index, index]
        assert own > 0
        others = [i for i in CONTROLLED_INDEX if i != index]
        assert np.abs(wrench[others, index]).max() < 1e-9 * own


def test_table_1_is_reproduced():
    """The totals of Table 1: 15.9, 32.2, 14.5 kg and 0.3 kg m^2, and the drag of Eq. 14."""
    vehicle = load_vehicle("paper")
    total = total_mass_matrix(vehicle).diagonal()[list(CONTROLLED_INDEX)]
    np.testing.assert_allclose(total, [15.9, 32.2, 14.5, 0.3])
    np.testing.assert_allclose(vehicle.linear_drag.diagonal()[list(CONTROLLED_INDEX)], [36.8, 60.6, 112.2, 0.32])
    np.testing.assert_allclose(vehicle.quadratic_drag[list(CONTROLLED_INDEX)], [374.7, 197.2, 153.2, 0.95])


def test_an_unknown_name_lists_the_vehicles():
    """The error says what there is."""
    with pytest.raises(
        FileNotFoundError, match="there are ardusub_sitl, bluerov2, bluerov2_heavy, milliampere, otter, paper, remus100"
    ):
        load_vehicle("submarine")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("colour", "yellow", r"unknown entries \['colour'\]"),
        ("rigid_body.weight", 1.0, r"unknown entries \['weight'\] in rigid_body: there are"),
        ("thrusters.bearing", 1.0, r"unknown entries \['bearing'\] in thrusters"),
        ("rigid_body.mass", ..., "rigid_body.mass is missing"),
        ("mixer", ..., "mixer is missing"),
        ("thrusters", ..., "thrusters.position, thrusters.direction, thrusters.full_thrust, .* are missing"),
        ("rigid_body", 12.0, "rigid_body is 12.0: give a mapping"),
        ("thrusters", None, "thrusters is None: give a mapping"),
        ("rigid_body.mass", "heavy", "rigid_body.mass is 'heavy': give one number"),
        ("rigid_body.mass", 0.0, "rigid_body.mass is 0.0: give values above 0"),
        ("rigid_body.mass", math.nan, "give one number, finite"),
        ("rigid_body.mass", [1.0, 2.0], "give one number"),
        ("rigid_body.mass", True, "rigid_body.mass is True"),
        ("rigid_body.inertia", [0.1, -0.1, 0.1], "rigid_body.inertia is .*: give values above 0"),
        ("added_mass", [1.0, 2.0], "added_mass is .*: give 6 numbers"),
        ("linear_drag", [-1.0] * 6, "linear_drag is .*: give values of 0 or more"),
        ("thrusters.limit", -5.0, "thrusters.limit is -5.0: give values above 0"),
        ("thrusters.asymmetry", 1.5, "thrusters.asymmetry is 1.5"),
        ("thrusters.position", [], "thrusters.position is .*: give one row of 3 numbers per thruster"),
        ("thrusters.position", [[0.1, 0.2]] * 6, r"thrusters.position\[0\] is .*: give 3 numbers"),
        ("thrusters.direction", [[0.0, 0.0, 0.0]] * 6, "a row of thrusters.direction is zero"),
        ("thrusters.direction", [[1.0, 0.0, 0.0]] * 5, "thrusters.direction 5"),
        ("mixer", [[1, 0, 0, 0, 0, 0]] * 3, "mixer 3: give one row per thruster"),
        ("name", ["a", "b"], r"name is \['a', 'b'\]: give a word"),
        ("name", None, "name is None: give a word"),
        ("sensors", 1.02, "sensors is 1.02: give a mapping"),
        ("sensors", {"depth": 1.02}, r"unknown entries \['depth'\] in sensors"),
        ("sensors", {"depth_scale": 0.0}, "depth_scale is 0.0: give values above 0"),
        ("sensors", {"pose_delay": -0.1}, "pose_delay is -0.1: give values of 0 s or more"),
    ],
)
def test_mistakes_are_named(path, value, message):
    """A missing, unknown, misshapen or unphysical entry is an error that names it and says what to give."""
    with pytest.raises(ValueError, match=message):
        load_vehicle(with_entry(paper(), path.split("."), value))


def test_what_sensors_are_known_to_be_off_by_is_nominal():
    """A gauge that reads sea water as fresh is part of the vehicle, and an effect of it counts from there."""
    vehicle = load_vehicle(with_entry(paper(), ["sensors"], {"depth_scale": 1.025}))
    assert float(vehicle.depth_scale) == 1.025 and float(vehicle.position_scale) == 1.0
    assert EFFECTS["depth_scale"].nominal(vehicle) == {"factor": 1.025}


@pytest.mark.parametrize("text", ["", "- 1\n- 2\n", "just words", "mass: [1, 2"])
def test_a_file_that_is_no_vehicle_is_refused(tmp_path, text):
    """An empty, foreign or broken file is an error that names the file."""
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match="broken.yaml"):
        load_vehicle(path)
