"""A damaged log holds the damage that its label says, and an answer about it is judged by what it blames."""

from collections import Counter

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid

from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import FlightLogError, read_flightlog, write_columns
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.cases import Case, draw_cases
from benchmarks.blind.flights.damages import BOTH, DAMAGES, FAULTS, can_show, damaged, shows_fault
from benchmarks.blind.flights.fly import fly
from benchmarks.blind.scores.judge import judge
from benchmarks.blind.scores.judge_damage import REFUSALS
from benchmarks.blind.scores.score import numbers
from benchmarks.blind.scores.score_damage import by_damage
from benchmarks.blind.seal import hand_over, log_path, open_labels, read_manifest, seal
from tests.benchmarks.test_scoring import gain_label

VEHICLE = load_vehicle("paper")
FUTURE = {"position_scale", "velocity_scale", "depth_bias", "depth_scale", "clock_scale"}  # may be in the library


def columns(episodes=2, seconds=30.0):
    """Raw columns of a smooth motion with noise on it."""
    rng = np.random.default_rng(0)
    t = np.tile(np.arange(0, seconds, 0.05), episodes)
    number = np.repeat(np.arange(episodes), len(t) // episodes)
    made = {"episode": number, "t": t}
    for i, name in enumerate((*BOTH, *(f"cmd_{k}" for k in range(1, 7)))):
        made[name] = 0.8 * np.sin((0.3 + 0.1 * i) * t + i) + 0.002 * rng.standard_normal(len(t))
    return made


@pytest.mark.parametrize("name", DAMAGES)
@pytest.mark.parametrize("seed", range(5))
def test_a_damage_changes_the_columns_that_it_names_and_no_other(name, seed):
    """The clean columns stay as they were, the same draw gives the same damage, and the sampling is whole."""
    clean, sound = columns(), columns()
    broken, which = damaged(sound, DAMAGES[name], np.random.default_rng(seed))
    again, _ = damaged(sound, DAMAGES[name], np.random.default_rng(seed))
    assert list(broken) == list(clean)
    for column, values in clean.items():
        np.testing.assert_array_equal(sound[column], values)
        np.testing.assert_array_equal(again[column], broken[column])
        assert len(broken[column]) == len(values)
        assert np.array_equal(broken[column], values) != (column in which)
    assert which or DAMAGES[name].healthy


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damage_is_named_by_what_the_diagnosis_can_say(name):
    """Its effects are in the library or to come, its codes have words for a refusal, and where it hides is known."""
    damage = DAMAGES[name]
    assert damage.codes and set(damage.codes) <= set(REFUSALS)
    assert set(damage.effects) <= set(EFFECTS) | FUTURE
    assert set(FAULTS) <= set(EFFECTS)


def test_a_column_stands_still_within_one_episode():
    """It does so for 5 to 20 s, and moves before and after."""
    for seed in range(20):
        broken, (column,) = damaged(columns(), DAMAGES["column_frozen"], np.random.default_rng(seed))
        still = np.flatnonzero(np.diff(broken[column]) == 0)
        assert 95 <= len(still) <= 401 and np.ptp(still) == len(still) - 1
        assert np.ptp(broken["episode"][still[0] : still[-1] + 2]) == 0


def test_units_signs_and_repeats_are_what_their_names_say():
    """Checked against clean columns."""
    clean = columns()

    def after(name):
        return damaged(clean, DAMAGES[name], np.random.default_rng(0))[0]

    np.testing.assert_allclose(after("feet")["z"] * 0.3048, clean["z"])
    np.testing.assert_allclose(after("knots")["u"], clean["u"] * 1.94384, rtol=1e-5)
    np.testing.assert_allclose(after("clock_halved")["t"], clean["t"] / 2)
    np.testing.assert_allclose(np.cos(after("heading_backwards")["yaw"] - clean["yaw"]), -1.0)
    assert after("commands_one_sided")["cmd_1"].min() > 0
    assert np.allclose(after("coarse")["x"] * 100, np.round(after("coarse")["x"] * 100))
    assert 0.05 < (np.diff(after("held_samples")["yaw"]) == 0).mean() < 0.15
    assert (np.diff(after("slow_sensor")["yaw"]) == 0).mean() == pytest.approx(0.75, abs=0.01)
    assert (np.abs(after("spikes")["x"] - clean["x"]) > 0.1).mean() in (0.0, 0.01)
    late = after("velocity_late")["u"]
    assert any(np.array_equal(late[k:600], clean["u"][: 600 - k]) for k in range(6, 13))


def test_a_log_without_the_column_is_refused():
    """A depth cannot be damaged where none is logged."""
    with pytest.raises(ValueError, match="depth_zero needs"):
        damaged({"t": np.zeros(3)}, DAMAGES["depth_zero"], np.random.default_rng(0))


def test_the_shipped_families_damage_in_every_way_and_leave_faults_visible():
    """50 cases have each damage twice or more, in both simulators; a fault stands beside what does not hide it."""
    cases = draw_cases(75, {"damaged": 50.0, "damaged_fault": 25.0}, seed=3)
    healthy = [case for case in cases if case.family == "damaged"]
    assert min(Counter(case.damage for case in healthy).values()) == 2
    assert set(Counter(case.damage for case in healthy)) == set(DAMAGES)
    assert all(case.effects == () or DAMAGES[str(case.damage)].healthy for case in healthy)
    beside = [case for case in cases if case.family == "damaged_fault"]
    assert all(can_show(DAMAGES[str(case.damage)], case.effects[0]) for case in beside)
    assert {case.effects[0] for case in beside} == set(FAULTS)
    assert {case.plant for case in healthy} == {"mujoco", "foreign"}


def test_a_vertical_thruster_does_not_show_in_a_log_without_depth():
    """A horizontal one does."""
    assert not shows_fault(DAMAGES["depth_zero"], "thruster_gain", {"gain_5": 0.4})
    assert shows_fault(DAMAGES["depth_zero"], "thruster_gain", {"gain_2": 0.4, "gain_5": 1.0})
    assert not shows_fault(DAMAGES["horizontal_zero"], "current", {"north": 0.2})


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    """A folder with three damaged cases: velocities beside the pose, a healthy log with the fault, no depth."""
    short = {"episodes": 2, "episode_s": 12.0}
    cases = [
        Case(1, "damaged", damage="velocity_negated", axes=BOTH, plant="foreign", **short),
        Case(
            2, "damaged", effects=("thruster_gain",), damage="healthy_with_fault", plant="foreign", healthy=2, **short
        ),
        Case(3, "damaged_fault", effects=("current",), damage="depth_zero", plant="mujoco", **short),
        Case(4, "damaged", damage="velocity_scaled", axes=BOTH, plant="mujoco", **short),
    ]
    folder = tmp_path_factory.mktemp("sealed")
    seal(folder, {"seed": 0}, fly(cases, VEHICLE, seed=0))
    return folder


def test_the_damage_reaches_the_file_and_the_manifest_does_not_tell(sealed):
    """The log that is read has the damage; the tasks name a healthy log where there is one, and nothing else."""
    logs = {name: read_flightlog(log_path(sealed, name), VEHICLE) for name in open_labels(sealed)}
    for name in ("case_0001", "case_0004"):
        assert set(BOTH) <= set(log_path(sealed, name).read_text().split("\n", 1)[0].replace('"', "").split(","))
    assert "pose_velocity_disagree" in {finding.code for finding in logs["case_0001"].findings}
    assert "z" not in logs["case_0003"].axes  # it never changes
    tasks = read_manifest(sealed)["tasks"]
    assert tasks == {
        "case_0001": {"left_out": None, "healthy": []},
        "case_0002": {"left_out": None, "healthy": ["case_0002_healthy"]},
        "case_0003": {"left_out": None, "healthy": []},
        "case_0004": {"left_out": None, "healthy": []},
    }
    handed = read_flightlog(log_path(sealed, "case_0002_healthy"), VEHICLE)
    assert len(handed.episodes) == len(logs["case_0002"].episodes) == 2
    assert not np.array_equal(handed.episodes[0].pose[:, 0], logs["case_0002"].episodes[0].pose[:, 0])


def test_reported_velocities_are_those_of_the_motion_in_both_simulators():
    """Logged u, v, w, r agree with the change of the logged pose: no finding says that they do not."""
    for plant in ("mujoco", "foreign"):
        case = Case(1, "damaged", damage="feet", axes=BOTH, plant=plant, episodes=2, episode_s=20.0)
        ((log, _),) = fly([case], VEHICLE, seed=1)
        for episode in log.episodes:
            yaw, u, v = episode.pose[:, 5], episode.velocity[:, 0], episode.velocity[:, 1]
            north = cumulative_trapezoid(np.cos(yaw) * u - np.sin(yaw) * v, episode.t, initial=0.0)
            assert np.ptp(north - episode.pose[:, 0]) < 0.06
            turned = cumulative_trapezoid(episode.velocity[:, 5], episode.t, initial=0.0)
            assert np.ptp(turned - np.unwrap(yaw)) < 0.1


def label(damage="depth_zero", effects=(), values=None):
    """The label of a damaged case."""
    d = DAMAGES[damage]
    values = values or {}
    by = {
        "codes": d.codes, "columns": ("z",) if d.mentions else (), "effects": d.effects, "partly": d.partly,
        "shows_fault": bool(effects),
    }  # fmt: skip
    return gain_label(1) | {
        "family": "damaged_fault" if effects else "damaged", "truth": "damage", "effects": effects,
        "values": values, "influence": {}, "damage": damage, "named_by": by,
    }  # fmt: skip


def effect(name, probability=1.0, thrusters=()):
    return {"name": name, "probability": probability, "parameters": {}, "thrusters": list(thrusters)}


def answer(*effects, findings=(), declared=()):
    """A diagnosis with these effects and findings (code, columns)."""
    return {
        "diagnosis": {
            "verdict": "explained" if effects else "no_gap", "effects": list(effects), "candidates": [],
            "indistinguishable": list(declared), "gap": {}, "where": {},
            "findings": [{"code": code, "columns": columns} for code, *columns in findings],
        },
        "seconds": 1.0, "cpu_s": 1.0,
    }  # fmt: skip


def test_a_sound_thruster_blamed_is_wrong_even_where_the_damage_is_named():
    """An effect held for more likely than not counts; one below that does not."""
    named = ("constant_column", "z")
    judged = judge("a", label(), answer(effect("thruster_gain", 0.99, (5,)), findings=[named]), VEHICLE)
    assert (judged.damage_named, judged.wrong_causes, judged.right) == (True, ("thruster_gain",), False)
    judged = judge("a", label(), answer(effect("thruster_gain", 0.4, (5,)), findings=[named]), VEHICLE)
    assert (judged.damage_named, judged.wrong_causes, judged.right) == (True, (), True)


def test_a_finding_about_another_column_does_not_name_the_damage():
    """The code alone is not enough where the column matters."""
    judged = judge("a", label(), answer(findings=[("constant_column", "x")]), VEHICLE)
    assert (judged.damage_named, judged.right) == (False, False)


def test_an_effect_names_a_damage_itself_or_declared_the_same():
    """heading_bias names a heading that is off; so does an answer that declares it."""
    assert judge("a", label("heading_backwards"), answer(effect("heading_bias")), VEHICLE).right
    given = answer(effect("thrust_curve"), declared=[["heading_bias", "thrust_curve"]])
    assert judge("a", label("heading_backwards"), given, VEHICLE).right
    aside = answer(effect("thrust_curve"), declared=[["heading_bias", "current"]])
    judged = judge("a", label("heading_backwards"), aside, VEHICLE)
    assert (judged.damage_named, judged.wrong_causes) == (False, ("thrust_curve",))


def test_reversed_vertical_thrusters_are_excused_beside_the_finding_that_offers_them():
    """With z up alone the log is the same; other thrusters are not, nor are these without the finding."""
    vertical, bow = effect("thruster_gain", 1.0, (5, 6)), effect("thruster_gain", 1.0, (1, 5))
    assert judge("a", label("z_up"), answer(vertical, findings=[("z_up_or_reversed", "z")]), VEHICLE).right
    assert judge("a", label("z_up"), answer(bow, findings=[("z_up_or_reversed", "z")]), VEHICLE).wrong_causes
    assert judge("a", label("z_up"), answer(vertical), VEHICLE).wrong_causes == ("thruster_gain",)


def test_the_fault_beside_the_damage_must_be_found_with_its_thruster():
    """At whatever probability; the same effect on another thruster is a wrong cause."""
    case = label("depth_zero", ("thruster_gain",), {"thruster_gain": {"gain_2": 0.5}})
    named = [("constant_column", "z")]
    judged = judge("a", case, answer(effect("thruster_gain", 0.3, (2,)), findings=named), VEHICLE)
    assert (judged.fault_found, judged.wrong_causes, judged.right) == (True, (), True)
    judged = judge("a", case, answer(effect("thruster_gain", 0.9, (3,)), findings=named), VEHICLE)
    assert (judged.fault_found, judged.wrong_causes, judged.right) == (False, ("thruster_gain",), False)
    judged = judge("a", case, answer(findings=named), VEHICLE)
    assert (judged.fault_found, judged.wrong_causes, judged.right) == (False, (), False)


@pytest.mark.parametrize(
    ("sentence", "right"),
    [("log.csv: z never changes", True), ("log.csv: x never changes", False), ("log.csv measures nothing", False)],
)
def test_a_refusal_names_the_damage_by_its_words(sentence, right):
    """A log that is refused for its damage blames nobody; another reason is no name."""
    judged = judge("a", label(), {"refused": sentence, "seconds": 1.0, "cpu_s": 1.0}, VEHICLE)
    assert (judged.right, judged.damage_named, judged.wrong_causes) == (right, right, ())
    assert judged.message == sentence
    crashed = judge("a", label(), {"error": sentence, "seconds": 1.0, "cpu_s": 1.0}, VEHICLE)
    assert not crashed.right and not crashed.damage_named


def test_the_tables_count_what_was_named():
    """Targets and the table by damage say how often something sound was blamed."""
    blamed = answer(effect("thruster_gain", 0.99, (5,)))
    seen = answer(findings=[("constant_column", "z")])
    judgements = [judge(str(i), label(), given, VEHICLE) for i, given in enumerate((blamed, seen, seen, seen))]
    measured = {row[0]: row[3] for row in numbers(judgements).rows}
    assert measured["damaged log: something sound blamed"].startswith("25.0% (1/4")
    assert measured["damaged log: the damage named"].startswith("75.0% (3/4")
    assert measured["fault beside a damage that leaves it visible: found"] == "–"
    assert by_damage(judgements).rows == [("depth zero", "4", "thruster_gain 1", "3/4", "", "thruster_gain 1")]


def test_what_is_handed_over_can_be_read(tmp_path):
    """Every damage of a flown log gives a file that is read, or refused in one line."""
    short = {"damage": "feet", "plant": "foreign", "episodes": 2, "episode_s": 12.0}
    axes = sorted({damage.axes for damage in DAMAGES.values()})
    cases = [Case(number, "damaged", axes=own, **short) for number, own in enumerate(axes)]
    for own, (log, drawn) in zip(axes, fly(cases, VEHICLE, seed=0), strict=True):
        for name, damage in DAMAGES.items():
            if damage.axes == own:
                path = tmp_path / f"{name}.csv"
                write_columns(hand_over(log, {**drawn, "damage": name}).log, path)
                try:
                    assert read_flightlog(path, VEHICLE).episodes
                except FlightLogError as error:
                    assert "\n" not in str(error)
