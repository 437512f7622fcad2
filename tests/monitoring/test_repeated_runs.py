"""Short runs of one manoeuvre, each held against sound ones."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from auv_torchrl.command import BAD_INPUT
from auv_torchrl.diagnosis import Verdict
from auv_torchrl.diagnosis.identify.hypotheses import apply_values, batch, load_settings
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Episode, FlightLog, FlightLogError, write_flightlog
from auv_torchrl.monitoring.healthy_runs import learn_distribution
from auv_torchrl.monitoring.repeated_runs import compare_runs, learn_healthy_runs
from auv_torchrl.monitoring.run_evidence import VIBRATION
from auv_torchrl.monitoring.run_sensitivities import run_sensitivities
from auv_torchrl.monitoring.runs import Runs, beginning, cut_runs
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import load_vehicle
from tests.command_lines import answers_of

FILE = load_vehicle("paper")
OWN = apply_values(FILE, {"linear_drag": {"scale_heave": 1.3}, "thrust_curve": {"exponent": 1.3}})  # it is 30 % off
SETTINGS = load_settings()
SECONDS, DT = 8.0, 0.05
FAULTS = {  # what happens to the vehicle, and effects of which the first to be said is one
    "load": ({"buoyancy": {"force": 6.0}}, {"buoyancy", "payload"}),
    "depth sensor": ({"depth_bias": {"offset": 0.2}}, {"depth_bias"}),
    "weak thruster": ({"thruster_gain": {"gain_5": 0.0}}, {"thruster_gain", "thrust_limit"}),
    "fouled": ({"linear_drag": {"scale_heave": 2.5}}, {"linear_drag", "quadratic_drag"}),
}
LEFT_OUT = {"depth sensor", "fouled"}  # of CI, for time


def dives(values, count, seed, seconds=SECONDS):
    """Runs of a vehicle that differ in weight by 0.7 N and in command by 2 %: dives with equal vertical thrusters."""
    rng, steps = np.random.default_rng(seed), round(seconds / DT)
    weight = values.get("buoyancy", {}).get("force", 0.0) + 0.7 * rng.standard_normal(count)
    vehicles = batch(OWN, [{**values, "buoyancy": {"force": float(own)}} for own in weight])
    commands = np.zeros((count, steps, 6))
    commands[:, 6:, 4:] = (0.5 * (1 + 0.02 * rng.standard_normal(count)))[:, None, None]
    flown = simulate(vehicles, commands, np.arange(steps + 1) * DT).reported
    pose, velocity = np.full((2, count, steps, 6), np.nan)
    pose[..., 2] = flown.position[:, :-1, 2] + 0.01 * rng.standard_normal((count, steps))
    velocity[..., 5] = flown.velocity[:, :-1, 5] + 0.02 * rng.standard_normal((count, steps))
    t = (np.arange(steps) * DT).astype(np.float64)
    episodes = [Episode(i, t, pose[i], velocity[i], commands[i], source=f"dive {i}") for i in range(count)]
    return FlightLog("dives", tuple(episodes), ("z", "r"))


@pytest.fixture(scope="module")
def sound():
    """Two sessions of sound runs, of a vehicle whose file is wrong."""
    return learn_healthy_runs([dives({}, 25, seed=1), dives({}, 15, seed=2)], FILE)


@pytest.mark.parametrize(
    "fault",
    [pytest.param(fault, marks=pytest.mark.thorough if fault in LEFT_OUT else ()) for fault in FAULTS],
)
def test_a_fault_is_named_by_runs_together(sound, fault):
    """Eight short runs with one fault name it, at most beside what shows the same, although the file is 30 % off."""
    values, names = FAULTS[fault]
    together = compare_runs([dives(values, 8, seed=3)], sound, FILE, SETTINGS).together
    assert together.verdict is Verdict.EXPLAINED, together.sentence
    assert {cause.name for cause in together.causes} & names, together.sentence


def test_the_size_of_an_offset_is_recovered(sound):
    """A depth reading that is 0.2 m too large is found in each of 20 runs, and lies in 16 or more of the intervals."""
    runs = compare_runs([dives(FAULTS["depth sensor"][0], 20, seed=4)], sound, FILE, SETTINGS).runs
    offsets = [run.causes[0].parameters["offset"] for run in runs]
    assert sum(offset.low < 0.2 < offset.high for offset in offsets) >= 16
    assert max(offset.high - offset.low for offset in offsets) < 0.1


def test_equal_commands_leave_several_thrusters(sound):
    """Of two thrusters that always get the same command, the answer names the one and the other."""
    together = compare_runs([dives(FAULTS["weak thruster"][0], 8, seed=5)], sound, FILE, SETTINGS).together
    (cause,) = [cause for cause in together.causes if cause.name == "thruster_gain"]
    assert {*cause.parameters, *(name for names in cause.instead for name in names)} >= {"gain_5", "gain_6"}
    assert "show the same" in cause.sentence


def test_sound_runs_stay_sound(sound):
    """Of forty further sound runs at most four differ, and all of them together do not."""
    told = compare_runs([dives({}, 40, seed=6)], sound, FILE, SETTINGS)
    assert sum(run.verdict is not Verdict.NO_GAP for run in told.runs) <= 4
    assert told.together.verdict is Verdict.NO_GAP


def test_what_is_in_no_library_is_not_explained(sound):
    """A depth that swings by itself is said to be unlike the sound runs, and nothing is blamed."""
    log = dives({}, 8, seed=7)
    for episode in log.episodes:
        episode.pose[:, 2] += 0.5 * np.sin(2 * np.pi * episode.t / 2.0)
    together = compare_runs([log], sound, FILE, SETTINGS).together
    assert together.verdict is Verdict.UNEXPLAINED
    assert together.causes == ()


def test_nothing_comes_about_that_cannot(sound):
    """No run is explained by thrust that was gained or by what belongs to a vehicle for good."""
    told = compare_runs(
        [dives({"thruster_gain": {f"gain_{i}": 1.4 for i in range(1, 7)}}, 8, seed=8)], sound, FILE, SETTINGS
    )
    for cause in (cause for run in (*told.runs, told.together) for cause in run.causes):
        assert not EFFECTS[cause.name].is_property
        assert all(estimate.value <= 1 for name, estimate in cause.parameters.items() if name.startswith("gain"))


def test_a_load_is_no_neutral_that_moved(sound):
    """A constant push between two runs is a load or trim: neutrals of speed controllers are set, and are not tried."""
    runs = cut_runs([dives({}, 2, seed=14)])
    _, sensitivities = run_sensitivities(FILE, runs, SETTINGS)
    tried = {candidate.effect for candidate in sensitivities.candidates}
    assert {"buoyancy", "payload"} <= tried and "neutral_offset" not in tried


def test_a_tether_of_the_vehicle_stays():
    """What a vehicle has by itself is in every sensitivity: a weight on a spring sinks to where the spring holds it."""
    moored = apply_values(FILE, {"tether": {"stiffness": 20.0}})
    runs = cut_runs([dives({}, 2, seed=13)])
    _, sensitivities = run_sensitivities(moored, runs, SETTINGS)
    (weight,) = [
        i
        for i, candidate in enumerate(sensitivities.candidates)
        if candidate.effect == "buoyancy" and candidate.values["force"] > 0
    ]
    force = sensitivities.candidates[weight].values["force"]
    assert sensitivities.change[weight, 0, 0, -1] < 1.1 * force / 20.0


def tables(seen, begun, session):
    """Runs with these numbers (N, C, B) that begin so (N, H), without spectra."""
    count, known = len(seen), ("roll", "pitch", "volts")[: begun.shape[1]]
    names, nothing = tuple(f"run {i}" for i in range(count)), np.empty((count, 0, 0))
    return Runs(names, session, ("z", "r"), np.zeros((count, 60, 1)), seen, (), nothing, 0.0, known, begun)


@given(arrays.arrays(float, (12, 2, 3), elements=st.floats(-1e3, 1e3)), st.integers(0, 9))
def test_a_scatter_is_always_usable(seen, seed):
    """Whatever twelve runs show, their covariance is positive, and small differences are small in its units."""
    seen = seen + 1e-3 * np.random.default_rng(seed).standard_normal(seen.shape)
    runs = tables(seen, np.empty((12, 0)), np.arange(12) // 4)
    distribution = learn_distribution(runs, np.zeros_like(seen))
    assert np.isfinite(distribution.root).all()
    assert (np.diag(distribution.root) > 0).all()
    assert distribution.session >= 0
    scatter = distribution.whitened(seen.reshape(12, -1) - distribution.expected(runs.beginnings))
    assert np.isfinite(scatter).all()
    assert np.abs(scatter).max() < 12


def leaning(count, session, seed):
    """Runs that show 0.3 m and 0.5 rad/s more for each radian that they lean, as they do from session to session."""
    rng = np.random.default_rng(seed)
    lean = (0.1 * np.random.default_rng(99).standard_normal(20))[session] + 0.02 * rng.standard_normal(count)
    seen = np.array([0.3, 0.5])[None, :, None] * lean[:, None, None] + 0.01 * rng.standard_normal((count, 2, 3))
    return tables(seen, lean[:, None], session)


def test_how_a_run_begins_is_no_fault():
    """Runs that lean further than most sound ones are expected to do what these do, and surely so where some did."""
    healthy = leaning(60, np.repeat(np.arange(6), 10), seed=20)
    distribution = learn_distribution(healthy, np.zeros_like(healthy.medians))
    begun = np.array([[0.25]])
    np.testing.assert_allclose(distribution.expected(begun)[0], 0.25 * np.repeat([0.3, 0.5], 3), atol=0.02)
    middle, far = (distribution.unit(np.full((8, 1), lean), np.arange(8)) for lean in (distribution.middle[0], 0.5))
    assert far > 1.5 * middle


def test_few_runs_depend_on_nothing():
    """Fifteen sound runs are too few to learn what they depend on."""
    healthy = leaning(15, np.repeat(np.arange(3), 5), seed=21)
    assert learn_distribution(healthy, np.zeros_like(healthy.medians)).line.shape == (1, 6)


def test_runs_of_many_sessions_tell_more():
    """Eight runs of one session are less sure together than eight of eight sessions, where sessions differ."""
    rng = np.random.default_rng(22)
    session = np.repeat(np.arange(10), 6)
    seen = 0.05 * rng.standard_normal((10, 2, 3))[session] + 0.03 * rng.standard_normal((60, 2, 3))
    healthy = tables(seen, np.empty((60, 0)), session)
    distribution = learn_distribution(healthy, np.zeros_like(seen))
    one, many = (distribution.unit(np.empty((8, 0)), of) for of in (np.zeros(8), np.arange(8)))
    assert one > 1.5 * many


def test_how_a_run_begins_is_read_before_it_pushes():
    """The beginning is what is measured until the commands change."""
    t = np.linspace(0.0, 4.95, 100)
    pose, velocity, commands = np.zeros((100, 6)), np.zeros((100, 6)), np.zeros((100, 6))
    pose[:, 3], commands[6:] = np.where(t < 0.29, 0.1, 0.4), 0.5
    episode = Episode(0, t, pose, velocity, commands, np.linspace(16.0, 15.0, 100))
    np.testing.assert_allclose(beginning(episode, ("roll", "volts")), [0.1, 16.0], atol=0.05)


def shaking(log, amplitude, frequency=3.1):
    """The same dives with a propeller that shakes the gyro."""
    rng = np.random.default_rng(30)
    for episode in log.episodes:
        wave = np.sin(2 * np.pi * frequency * episode.t + rng.uniform(0, 2 * np.pi))
        episode.velocity[:, 5] += amplitude * wave
    return log


def test_a_propeller_out_of_balance_is_heard(sound):
    """A line in the spectrum of the yaw rate, no larger than the noise of a sample, is named with its frequency."""
    together = compare_runs([shaking(dives({}, 8, seed=31), 0.015)], sound, FILE, SETTINGS).together
    assert together.causes[0].name == VIBRATION, together.sentence
    assert abs(together.causes[0].parameters["frequency"].value - 3.1) < 0.5
    assert together.causes[0].parameters["louder"].low > 1
    assert "propeller" in together.sentence


def test_a_fault_is_named_beside_what_shakes(sound):
    """Where a weak thruster does not shake, it is the thruster that is named and no vibration."""
    together = compare_runs([dives(FAULTS["weak thruster"][0], 8, seed=32)], sound, FILE, SETTINGS).together
    assert VIBRATION not in {cause.name for cause in together.causes}


def test_slower_samples_tell_no_vibration(sound):
    """Runs sampled at a fifth of the rate say that a vibration would not show, and are fit by the rest."""
    log = dives(FAULTS["load"][0], 8, seed=33)
    slow = [replace(e, **{n: getattr(e, n)[::5] for n in ("t", "pose", "velocity", "commands")}) for e in log.episodes]
    told = compare_runs([FlightLog("slow", tuple(slow), log.axes)], sound, FILE, SETTINGS)
    assert VIBRATION in told.cannot_tell
    assert told.together.verdict is Verdict.EXPLAINED


@pytest.mark.parametrize(
    ("logs", "says"),
    [
        ([dives({}, 9, seed=9)], "10 at least"),
        ([dives({}, 12, seed=9, seconds=2.0)], "are needed"),
    ],
)
def test_runs_that_tell_nothing_are_refused(logs, says):
    """Too few sound runs, and runs of two seconds, are refused with what is needed."""
    with pytest.raises(FlightLogError, match=says):
        learn_healthy_runs(logs, FILE)


def test_a_broken_run_is_left_out(sound):
    """A run that was broken off is named and left out, and the others are fit."""
    log = dives({}, 3, seed=10)
    short = log.episodes[1].rows(0, 80)
    told = compare_runs(
        [FlightLog("dives", (log.episodes[0], short, log.episodes[2]), log.axes)], sound, FILE, SETTINGS
    )
    assert told.left_out == ("dive 1",)
    assert [run.runs for run in told.runs] == [("dive 0",), ("dive 2",)]


def test_the_command(tmp_path):
    """alike=true writes what it says of every run; without sound runs it is refused with what to give."""
    paths = {}
    for name, (values, seed) in {"sound": ({}, 11), "odd": (FAULTS["load"][0], 12)}.items():
        paths[name] = tmp_path / f"{name}.csv"
        write_flightlog(dives(values, 15 if name == "sound" else 8, seed), paths[name])
    line = [f"log={paths['odd']}", f"healthy={paths['sound']}", "alike=true"]
    answers = answers_of(
        "diagnose",
        {"told": [*line, f"output={tmp_path / 'told'}"], "alone": [f"log={paths['odd']}", "alike=true"]},
    )
    code, output, errors = answers["told"]
    assert code == 0, errors
    told = json.loads((tmp_path / "told" / "alike.json").read_text())
    assert (told["version"], told["healthy"], len(told["runs"])) == (1, 15, 8)
    assert told["together"]["verdict"] == "explained"
    assert told["together"]["sentence"] in output
    code, _, errors = answers["alone"]
    assert code == BAD_INPUT
    assert "healthy=" in errors
