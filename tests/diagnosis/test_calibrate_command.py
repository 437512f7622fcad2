"""auv-calibrate: healthy flights become a vehicle file that training, flights and diagnoses read."""

import json

import numpy as np
import pytest
import yaml

from auv_torchrl.command import BAD_INPUT
from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.calibrate.correction import simulate_steps
from auv_torchrl.diagnosis.calibrate.parameters import load_uncertainty
from auv_torchrl.diagnosis.calibrate.scale_ambiguity import sample_accelerations
from auv_torchrl.diagnosis.calibrate.vehicle_file import read_calibration
from auv_torchrl.diagnosis.thresholds import Z95
from auv_torchrl.flightlog import read_flightlog, write_flightlog
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle, read_vehicle_file
from tests.command_lines import answers_of
from tests.diagnosis.flown_logs import fly, hold
from tests.diagnosis.healthy_flights import FAULT, FILE, OWN, flown

SHIPPED = PROJECT / "examples" / "flight.csv"
REFUSED = 3
BAD = {  # what is wrong: command line, what the answer names
    "nothing": (["output=mine.yaml"], "healthy=[a.csv,b.csv]"),
    "no output": ([f"healthy={SHIPPED}"], "output=my_vehicle.yaml"),
    "missing file": (["healthy=nowhere.csv", "output=mine.yaml"], "nowhere.csv"),
    "a word without a key": (["output=mine.yaml", "paper"], "paper is given without a key"),
    "given twice": ([f"healthy=[{SHIPPED},{SHIPPED}]", "output=mine.yaml"], "given twice"),
    "no YAML": ([f"healthy={SHIPPED}", "output=mine.txt"], "ends in .yaml"),
    "no folder": ([f"healthy={SHIPPED}", "output=nowhere/mine.yaml"], "no folder nowhere"),
    "there already": ([f"healthy={SHIPPED}", "output=THERE"], "exists"),
    "unknown vehicle": ([f"healthy={SHIPPED}", "vehicle=papr", "output=mine.yaml"], "bluerov2"),
    "wrong vehicle": ([f"healthy={SHIPPED}", "vehicle=bluerov2_heavy", "output=mine.yaml"], "8 thrusters"),
    "misspelt key": ([f"healthy={SHIPPED}", "helthy=3", "output=mine.yaml"], "did you mean healthy"),
}


def load_kept(file, vehicle):
    content = read_vehicle_file(file)
    return read_calibration(content.get("calibration"), load_uncertainty(file, vehicle))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the logs and vehicles of this module are."""
    return tmp_path_factory.mktemp("calibrate")


@pytest.fixture(scope="module")
def answers(folder):
    """Exit code, output and errors of every command line."""
    there = folder / "there.yaml"
    there.write_text("precious: 1\n")
    lines = {case: [word.replace("THERE", str(there)) for word in words] for case, (words, _) in BAD.items()}
    write_flightlog(flown("a", seconds=20.0), folder / "a.csv")
    lines["mine"] = [f"healthy={folder / 'a.csv'}", f"output={folder / 'mine.yaml'}"]
    right = [fly(FILE, {}, seed=seed, episodes=2, seconds=15.0) for seed in (40, 41)]
    paths = [write_flightlog(log, folder / f"right_{name}.csv") for name, log in zip("ab", right, strict=True)]
    lines["right"] = [f"healthy=[{paths[0]},{paths[1]}]", f"output={folder / 'right.yaml'}"]
    (folder / "other").mkdir()
    (folder / "other" / "a.csv").write_bytes((folder / "a.csv").read_bytes())
    namesakes = f"healthy=[{folder / 'a.csv'},{folder / 'other' / 'a.csv'}]"
    lines["same name"] = [namesakes, f"output={folder / 'same.yaml'}"]
    lines["help"] = ["--help"]
    return answers_of("calibrate", lines)


@pytest.fixture(scope="module")
def mine(answers, folder):
    """The vehicle file of a healthy flight; that of two takes twice as long."""
    code, out, err = answers["mine"]
    assert (code, err.strip()) == (0, "")
    assert "a.csv: position" in out and "mine.yaml is a vehicle now" in out
    return folder / "mine.yaml"


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line(answers, case):
    """What is wrong with a command line is said in one line that names it."""
    code, _, err = answers[case]
    assert code == BAD_INPUT
    assert BAD[case][1] in err and err.count("\n") == 1


def test_what_is_there_is_not_touched(answers, folder):
    """Neither the file that was in the way nor the working directory."""
    assert answers["there already"][0] == BAD_INPUT
    assert (folder / "there.yaml").read_text() == "precious: 1\n"
    assert not [path for path in folder.iterdir() if path.suffix not in (".csv", ".yaml") and path.name != "other"]


def test_help_explains_every_setting(answers):
    """--help names each key of conf/calibrate.yaml."""
    code, out, _ = answers["help"]
    keys = yaml.safe_load((PROJECT / "conf" / "calibrate.yaml").read_text())
    assert code == 0 and all(key.replace("_", "-") in out for key in set(keys) - {"defaults", "help", "diagnosis"})


def test_a_file_that_is_right_is_kept(answers, folder):
    """Nothing is written where unseen flight is predicted no better, and the answer says so."""
    code, _, err = answers["right"]
    assert code == REFUSED
    assert "vehicle=paper" in err and "nothing was written" in err and err.count("\n") == 1
    assert not (folder / "right.yaml").exists()


def test_the_vehicle_flies_like_the_one_that_was_flown(mine):
    """Speeds and time constants, which a log tells, are right within 4 %; those of the file were off by up to 60 %."""
    truth, found, before = (simulate_steps(vehicle, 0.4) for vehicle in (OWN, load_vehicle(mine), FILE))
    own = np.array([2, 0, 1, 2, 5])  # degrees of freedom of the five commands, idle first
    moved, found_speed, file_speed = (np.abs(r.steady[np.arange(5), own])[1:] for r in (truth, found, before))
    np.testing.assert_allclose(found_speed, moved, rtol=0.04)
    np.testing.assert_allclose(found.time_s[1:], truth.time_s[1:], rtol=0.04, atol=0.06)
    assert np.abs(file_speed / moved - 1).max() > 0.15


def test_the_file_says_how_sure_it_is_and_what_it_was_made_from(mine):
    """A deviation for each coefficient, the interval in words, logs, floor and noise."""
    text, content = mine.read_text(), read_vehicle_file(mine)
    coefficients = load_uncertainty(mine, load_vehicle(mine))
    assert {"thruster_gain", "added_mass", "buoyancy", "current"} <= {c.effect for c in coefficients}
    assert content["calibration"]["logs"] == ["a.csv"]
    assert content["calibration"]["noise"]["x"] == pytest.approx(0.002, rel=0.15)
    lines = [line for line in text.splitlines() if "gain_1:" in line]
    assert len(lines) == 1 and "times its nominal thrust; 95 % in [" in lines[0]


def test_the_round_trip_keeps_what_the_logs_tell_together(mine):
    """Gains are unsure by a scale that all share, their differences are not; so it is after reading."""
    vehicle = load_vehicle(mine)
    kept = load_kept(mine, vehicle)
    assert kept is not None
    places = [i for i, entry in enumerate(kept.nuisance) if entry[1] in ("gain_1", "gain_2")]
    inside = kept.prior.nuisance_covariance[np.ix_(places, places)]
    assert kept.prior.scales is not None
    by_scale = kept.prior.scales[places]
    np.testing.assert_allclose(by_scale[0], by_scale[1], rtol=1e-3)
    assert inside[0, 0] + inside[1, 1] - 2 * inside[0, 1] < 0.2 * (inside[0, 0] + (by_scale[0] ** 2).sum())
    assert np.linalg.eigvalsh(kept.prior.nuisance_covariance).min() > 0


def test_no_healthy_logs_are_needed_any_more(mine):
    """A diagnosis with the file finds a fault and nothing else, and a healthy flight healthy, as with healthy=."""
    vehicle = hold(load_vehicle(mine))
    kept = load_kept(mine, vehicle)
    sound = diagnose(flown("sound", seed=7), vehicle, kept=kept)
    assert sound.verdict is Verdict.NO_GAP
    assert "calibration_kept" in {finding.code for finding in sound.findings}
    assert not {"floor_assumed"} & {finding.code for finding in sound.findings}


@pytest.mark.thorough
def test_a_place_is_as_unsure_as_the_scales_that_no_flight_tells(mine):
    """Where what pulls in heave and sway leads is said within three deviations, of a file that is far off in one."""
    values = {"north": 2.5, "east": -3.0, "down": 0.3, "stiffness": 9.0, "slack": 3.0}
    vehicle = hold(load_vehicle(mine))
    (effect,) = diagnose(flown("tied", {"tether": values}, seed=9), vehicle, kept=load_kept(mine, vehicle)).effects
    assert effect.name == "tether"
    for name, told in effect.parameters.items():
        assert abs(told.value - values[name]) < 3 / Z95 * (told.high - told.low) / 2
    assert effect.parameters["slack"].low > 1.0


@pytest.mark.thorough
def test_intervals_are_those_that_the_healthy_logs_give(mine, folder):
    """The same fault, as sure as beside the healthy logs themselves: what they leave open is kept as wide as it is."""
    faulty, vehicle = flown("faulty", FAULT, seed=8), hold(load_vehicle(mine))
    healthy = [read_flightlog(folder / "a.csv", FILE)]
    (given,) = diagnose(faulty, FILE, healthy).effects
    (effect,) = diagnose(faulty, vehicle, kept=load_kept(mine, vehicle)).effects
    assert (effect.name, effect.thrusters) == ("thruster_gain", (3,))
    kept, there = (one.parameters["gain_3"] for one in (effect, given))
    assert (kept.value, kept.low, kept.high) == pytest.approx((there.value, there.low, there.high), abs=1e-5)
    assert kept.low < 0.6 < kept.high


def test_a_file_that_does_not_say_what_more_flights_would_tell_is_read_as_ever(mine):
    """Files of older versions have no ``shrinks``: then none of it is known, and all else is the same."""
    content = json.loads(json.dumps(read_vehicle_file(mine)))
    vehicle = load_vehicle(content)
    kept = load_kept(content, vehicle)
    del content["calibration"]["shrinks"]
    older = load_kept(content, vehicle)
    assert kept is not None and older is not None
    now, before = kept.prior, older.prior
    assert now.flights == 1 and now.shrinks is not None
    assert np.linalg.eigvalsh(now.nuisance_covariance - now.shrinks).min() > -1e-6
    assert (before.flights, before.shrinks) == (0, None)
    assert np.array_equal(before.nuisance_covariance, now.nuisance_covariance)


HOSTILE = {
    "no mapping": (["calibration"], 3, "no mapping"),
    "unknown": (["calibration", "flor"], [1.0] * 6, "did you mean floor"),
    "missing": (["calibration", "floor"], None, "floor missing"),
    "floor of words": (["calibration", "floor"], ["a"] * 6, "floor"),
    "floor of nothing": (["calibration", "floor"], [0.0] * 6, "above 0"),
    "floor of infinity": (["calibration", "floor"], [float("inf")] * 6, "above 0"),
    "strange channel": (["calibration", "noise"], {"salt": 1.0}, "out of x"),
    "too few rows": (["calibration", "together"], [[1.0]], "one row for each"),
    "more than all": (["calibration", "shrinks"], [[2.0]], "shrinks"),
    "level of nothing": (["calibration", "level"], "yes", "level"),
    "too few scales": (["calibration", "scales"], [[0.1, 0.2]], "scales has not"),
    "scale of everything": (["calibration", "scales", 0, 0], float("nan"), "no numbers"),
    "another length": (["uncertainty", "added_mass"], None, "one row for each"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_section_that_nobody_wrote_is_refused_by_name(mine, case):
    """Edited files are refused in one line with a remedy, not believed."""
    path, value, words = HOSTILE[case]
    content = json.loads(json.dumps(read_vehicle_file(mine)))
    block = content
    for key in path[:-1]:
        block = block[key]
    if value is None:
        del block[path[-1]]
    else:
        block[path[-1]] = value
    vehicle = load_vehicle(content)
    with pytest.raises(ValueError, match=words) as refused:
        load_kept(content, vehicle)
    assert "\n" not in str(refused.value)


def test_a_vehicle_that_was_not_calibrated_keeps_nothing():
    """None, and a diagnosis goes on as ever."""
    assert load_kept("paper", FILE) is None
    assert read_calibration(None, ()) is None


def test_gains_and_trim_become_coefficients_without_changing_the_motion():
    """Folding is exact, also for a thruster that turns the other way and a file with roll and pitch free."""
    from auv_torchrl.diagnosis.identify.hypotheses import apply_values
    from auv_torchrl.vehicle.changed_file import entries, fold

    values = {"thruster_gain": {"gain_1": -0.7, "gain_4": 1.3}, "buoyancy": {"force": 3.0}}
    values |= {"drag_coupling": {"drag_sway_from_yaw": 2.0}, "added_mass": {"scale_surge": 0.6}}
    values |= {"thrust_curve": {"exponent": 1.3, "asymmetry": -0.1}}
    changed = apply_values(load_vehicle("bluerov2"), values)
    read = load_vehicle(entries(fold(changed), "mine"))
    moves = np.ones(6, bool)
    before, after = (sample_accelerations(one.expand(1).clone(), moves) for one in (changed, read))
    np.testing.assert_allclose(after, before, rtol=1e-5, atol=1e-5)
    dead = apply_values(FILE, {"thruster_gain": {"gain_2": 0.0}})
    with pytest.raises(ValueError, match="thruster 2 gives nothing"):
        fold(dead)
    with pytest.raises(ValueError, match="cannot say battery_sag"):
        entries(replace_field(fold(OWN), "battery_sag", 0.1), "mine")


def replace_field(vehicle, name, value):
    copy = vehicle.replace(**{name: np.array(value, dtype=np.float64)})
    return copy


def test_flights_with_one_name_are_refused(answers):
    """They could not be told apart in what is said of them."""
    code, _, err = answers["same name"]
    assert code == BAD_INPUT and "same name" in err
