"""A vehicle for other simulators: flown in MuJoCo beside ours, read back, and marked by where numbers come from."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from auv_torchrl.export.ardusub import ardusub
from auv_torchrl.export.fossen import fossen, rows
from auv_torchrl.export.marks import Kind, read_described
from auv_torchrl.export.mjcf import boxes, mjcf
from auv_torchrl.export.sdf import sdf
from auv_torchrl.paths import config_path
from auv_torchrl.sensors import CHANNELS
from auv_torchrl.simulator import simulate
from tests.command_lines import answers_of

DT, STEPS = 0.05, 100
TOGETHER = [[1.0], [0.95, 0.3122499], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]


def commands(vehicle):
    """(T, n): each second other demands on surge, sway, heave and yaw."""
    demands = np.zeros((STEPS, 6))
    demands[:, [0, 1, 2, 5]] = np.random.default_rng(0).uniform(-0.5, 0.5, (STEPS // 20, 4)).repeat(20, axis=0)
    return np.clip(demands @ vehicle.mixer.T, -1, 1)


def thrusts(vehicle, command):
    """N, of thrusters without lag."""
    reverse = np.where(command < 0, 1 - vehicle.asymmetry, 1.0)
    force = np.sign(command) * np.abs(command) ** vehicle.exponent * reverse * vehicle.full_thrust
    return np.where(np.abs(force) < vehicle.dead_band, 0.0, np.clip(force, -vehicle.limit, vehicle.limit))


def apart(described):
    """How far MuJoCo with the exported file and our simulator are apart after 5 s, and how long the way was, m."""
    vehicle = described.vehicle
    command = commands(vehicle)
    ours = simulate(vehicle, command[None], np.arange(STEPS + 1) * DT).states[0][:, :3]
    mujoco: Any = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(mjcf(described))
    data = mujoco.MjData(model)
    for force in thrusts(vehicle, command):
        data.ctrl[: len(force)] = force  # behind them are those of drag, which take none
        for _ in range(round(DT / model.opt.timestep)):
            mujoco.mj_step(model, data)
    there = data.qpos[:3] * (1, -1, -1)  # z is up there
    return float(np.linalg.norm(there - ours[-1])), float(np.linalg.norm(np.diff(ours, axis=0), axis=1).sum())


def test_the_exported_mjcf_flies_as_ours_where_mujoco_has_all_terms():
    """Weight, buoyancy, both drags and the thrusters: 1 cm on a way of more than 4 m."""
    off, way = apart(read_described("ardusub_sitl"))  # has no added mass
    assert off < 0.01 and way > 4.0
    described = read_described("bluerov2_heavy")
    added = described.vehicle.added_mass.copy()
    added[:3] = added[:3].mean()
    off, way = apart(replace(described, vehicle=described.vehicle.replace(added_mass=added)))
    assert off < 0.02 and way > 1.5


def test_added_mass_that_differs_by_direction_is_what_mujoco_lacks():
    """It is said in the file, and this is what it costs."""
    described = read_described("bluerov2_heavy")
    off, way = apart(described)
    assert 0.05 < off / way < 0.4
    assert "left out: added mass that differs by direction; the thrust curve" in mjcf(described)


def test_boxes_resist_as_they_are_asked_to():
    """Six coefficients as vehicles have them; none where none is asked for."""
    assert boxes(np.zeros(6)) == []
    for asked in ((141, 217, 190, 1.19, 0.47, 1.5), (18, 22, 37, 1.55, 1.55, 1.55), (500, 700, 900, 90, 99, 120)):
        a, b, c = np.array(boxes(np.array(asked, float))).T
        linear = [500 * side.sum() for side in (b * c, c * a, a * b)]
        turning = [(p * (q**4 + r**4)).sum() * 1000 / 64 for p, q, r in ((a, b, c), (b, c, a), (c, a, b))]
        np.testing.assert_allclose((*linear, *turning), asked, rtol=0.02, atol=0.3)


def test_sdf_has_the_numbers_in_gazebos_axes():
    """Derivatives are negative, y and z change their sign; one plugin for the water, one for each thruster."""
    described = read_described("bluerov2_heavy")
    vehicle, model = described.vehicle, ET.fromstring(sdf(described)).find("model")
    assert model is not None
    water, *propellers = model.findall("plugin")
    assert water.findtext("xDotU") == "-6.36" and water.findtext("yVabsV") == "-217" and water.findtext("zW") == "-33"
    assert len(propellers) == 8 and float(propellers[0].findtext("max_thrust_cmd", "")) == 51.5
    poses = [[float(x) for x in link.findtext("pose", "").split()[:3]] for link in model.findall("link")[1:]]
    np.testing.assert_allclose(poses, vehicle.thruster_position * (1, -1, -1))
    axes = [[float(x) for x in joint.findtext("axis/xyz", "").split()] for joint in model.findall("joint")]
    np.testing.assert_allclose(axes, vehicle.thruster_direction * (1, -1, -1), atol=1e-8)
    masses = [float(entry.text or "") for entry in model.iter("mass")]
    assert sum(masses) == pytest.approx(13.5)


def test_parameters_name_the_frame_and_another_mixer_is_refused():
    """ArduSub's own coefficients are no parameters, and the file says so."""
    text = ardusub(read_described("bluerov2_heavy"))
    assert "FRAME_CONFIG 2" in text and "SERVO8_FUNCTION 40" in text and "auv-sim --vehicle bluerov2_heavy" in text
    with pytest.raises(ValueError, match="none of ArduSub's frames that are known, vectored, vectored_6dof"):
        described = read_described("bluerov2")
        ardusub(replace(described, vehicle=described.vehicle.replace(mixer=-described.vehicle.mixer)))


@pytest.fixture
def calibrated(tmp_path):
    """A file as a calibration writes it: two numbers that are told together, one with the scale, one by itself."""
    content = yaml.safe_load(config_path("vehicle", "bluerov2").read_text())
    content["uncertainty"] = {
        "hull": {"linear_surge": 1.0, "linear_sway": 2.0, "linear_heave": 3.0, "quadratic_surge": 4.0}
    }
    noise = {CHANNELS[0]: 0.01}
    content["calibration"] = {
        "logs": ["a.BIN"], "seconds": 200.0, "vehicle": "bluerov2", "made": "today", "version": "0.1.0", "excess": 1.1,
        "level": False, "floor": [1.0] * 6, "noise": noise, "rough_noise": noise, "together": TOGETHER,
        "scales": [[0.0], [0.0], [0.8], [0.1]],
    }  # fmt: skip
    path = tmp_path / "mine.yaml"
    path.write_text("# unseen flight: 0.31 m after 5 s by the file, 0.08 m now\n" + yaml.safe_dump(content))
    return path


def test_each_number_is_marked_by_where_it_comes_from(calibrated):
    """Of a calibrated file: told, tied to another, or as the file has it; the errors of held-out flight go with it."""
    described = read_described(str(calibrated))
    kinds = {symbol: mark.kind for symbol, _, _, mark in rows(described)}
    assert kinds["X_\\|u\\|u"] is Kind.TOLD
    assert kinds["X_u"] is Kind.TIED and kinds["Y_v"] is Kind.TIED and kinds["Z_w"] is Kind.TIED
    assert kinds["m"] is Kind.FILE and kinds["K_p"] is Kind.FILE
    table = fossen(described)
    assert (
        "| X_u | -4.03 | kg/s | tied to another: hull.linear_sway, correlation 0.95; hull.linear_surge +- 1 kg/s |"
        in table
    )
    assert "tied to another: the overall scale of masses" in table
    for text in (table, mjcf(described), sdf(described), ardusub(described)):
        assert "unseen flight: 0.31 m after 5 s by the file, 0.08 m now" in text


def test_without_a_calibration_all_numbers_are_from_the_file():
    """With what the file says is uncertain."""
    described = read_described("bluerov2")
    assert {mark.kind for *_, mark in rows(described)} == {Kind.FILE}
    assert "the error of held-out flight is not known" in fossen(described)


LINES = {
    "format=urdf": "give one of mjcf, sdf, ardusub, fossen",
    "format=mjcf vehicle=submarine": "no vehicle named 'submarine'",
    "policy=x": "give policy=FOLDER, or vehicle=FILE",
    "format=mjcf vehicle=remus100": "remus100 has fins, which mjcf has no force for: give format=fossen",
}


def test_the_command_writes_the_file_and_refuses_what_it_cannot(tmp_path):
    """By vehicle= and format=."""
    lines = {}
    for number, line in enumerate((*LINES, "format=fossen")):
        given = line.split() if "vehicle=" in line else [*line.split(), "vehicle=bluerov2"]
        lines[line] = [*given, f"output={tmp_path / str(number)}"]
    answers = answers_of("auv_torchrl.export.command", lines)
    for line, says in LINES.items():
        code, _, errors = answers[line]
        assert code == 2 and says in errors and errors.count("\n") == 1, errors
    assert answers["format=fossen"][0] == 0
    assert "| X_udot | -5.5 |" in (tmp_path / str(len(LINES)) / "vehicle.md").read_text()


def test_fins_are_written_for_people():
    """Their full command is an angle, and area and lift stand beside it."""
    shown = {symbol: (value, unit) for symbol, value, unit, _ in rows(read_described("remus100"))}
    assert shown["K_1"] == (10.9, "N at command 1") and shown["K_2"] == (0.237, "rad at command 1")
    assert shown["A_2"] == (6.65e-3, "m^2, a fin") and "A_1" not in shown
