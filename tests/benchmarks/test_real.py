"""Benchmarks on logs of real vehicles, on tables like theirs."""

import lzma
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from auv_torchrl.diagnosis import Verdict
from auv_torchrl.diagnosis.identify.hypotheses import batch, load_settings
from auv_torchrl.diagnosis.verdict import Slice, ThrustMap
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import Finding, FlightLog, FlightLogError, Severity
from auv_torchrl.flightlog.log import AXES, Episode
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.physics.step import rest_state
from auv_torchrl.simulator import simulate
from auv_torchrl.vehicle import load_vehicle
from benchmarks.published import SECTIONS as TABLES
from benchmarks.published import problems
from benchmarks.real import __main__ as page
from benchmarks.real import altered, ardusub, haizhe, orca, rov2016, saab
from benchmarks.real.page import SECTIONS
from tests.flightlog.shared_data import shared

RUNS, ROWS = 40, 120
FLOWN = {haizhe.NORMAL: {}, haizhe.LOAD: {"buoyancy": {"force": 3.0}}, haizhe.DEPTH: {"depth_bias": {"offset": 0.2}}}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A file like the real one, of a vehicle of which all is known."""
    rng, columns = np.random.default_rng(0), {}
    pulses = np.full((RUNS, ROWS, 4), haizhe.STOPPED)
    pulses[:, 3:] = np.round(1200 + 3 * rng.standard_normal((RUNS, 1, 1)))
    for place, (name, values) in enumerate(FLOWN.items()):
        weight = values.get("buoyancy", {}).get("force", 0.0) + 0.3 * rng.standard_normal(RUNS)
        vehicles = batch(haizhe.own_vehicle(), [{**values, "buoyancy": {"force": float(own)}} for own in weight])
        commands = (pulses - haizhe.STOPPED) / haizhe.REACH
        flown = simulate(vehicles, commands, np.arange(ROWS + 1) / haizhe.RATE).reported
        depth = flown.position[:, :-1, 2] + 0.01 * rng.standard_normal((RUNS, ROWS))
        turning = -np.degrees(flown.velocity[:, :-1, 5]) + rng.standard_normal((RUNS, ROWS))
        own = {
            "run": np.repeat([f"{name}_{i}" for i in range(RUNS)], ROWS),
            "class": np.full(RUNS * ROWS, name),
            "time": np.repeat(100000 + 100 * (np.arange(RUNS) // 4 + 10 * (np.arange(RUNS) // 20)), ROWS) + place,
            "depth": depth.reshape(-1),
            "roll": 5.0 + rng.standard_normal(RUNS * ROWS),
            "pitch": rng.standard_normal(RUNS * ROWS),
            "voltage": np.repeat(12.0 + 0.2 * rng.standard_normal(RUNS), ROWS),
            "w_yaw": turning.reshape(-1),
            **{f"pwm{i + 1}": pulses[..., i].reshape(-1) for i in range(4)},
        }
        columns = {key: np.concatenate([columns[key], value]) if columns else value for key, value in own.items()}
    path = tmp_path_factory.mktemp("real") / haizhe.FILE
    path.parent.mkdir()
    pq.write_table(pa.table(columns), path)
    return path


def test_runs_of_known_faults_are_told_apart(table):
    """Of runs that the simulator flew, loads and depth sensors are found, and groups of eight are all right."""
    classes = haizhe.read_classes(table)
    assert [len(logs) for logs in classes.values()] == [2, 2, 2], "sessions are parted where nobody flew"
    scored = haizhe.score(classes, load_settings(), seed=1)
    shares = haizhe.shares(scored)
    assert shares["load, depth sensor or the rest"] > 0.9
    assert shares["groups of 8, damages merged"] == 1
    assert shares["normal runs called faulty"] <= 0.2
    assert len(list(haizhe.table(scored))) == 2 + len(FLOWN) + 1 + len(shares)
    for own in scored:
        pairs = zip(own.single, own.scores, strict=True)
        assert all(said == own.truth for said, score in pairs if score is haizhe.Score.RIGHT)
        assert own.scores.count(haizhe.Score.RIGHT) > 0.7 * len(own.scores)


def test_what_is_absent_is_named(tmp_path, monkeypatch, capsys):
    """With no logs at hand, every part says what it lacks."""
    monkeypatch.setattr("sys.argv", ["real", "--data", str(tmp_path), "--kept", str(tmp_path / "kept")])
    page.main()
    shown = capsys.readouterr().out
    assert "run_11_40_38.csv" in shown
    assert "haizhe/train.parquet" in shown


def counted(tmp_path, measure):
    """A section of two measurements, of which the tables are their results in a row each."""
    return replace(
        SECTIONS[0], name="ardusub", labels=("one", "two"), missing=lambda data, label: "", measure=measure,
        lines=lambda results: (f"| {result['row']} |" for result in results),
    )  # fmt: skip


def test_a_part_of_the_page_is_published_alone(tmp_path, monkeypatch):
    """Its table is written with its commit, and what stands around it stays."""
    document = tmp_path / "real.md"
    document.write_text("# Head\n\n<!-- ardusub: begin -->\nold\n<!-- ardusub: end -->\n\nRest.\n")
    monkeypatch.setattr(page, "PAGE", document)
    monkeypatch.setattr(page, "SECTIONS", [counted(tmp_path, None)])
    monkeypatch.setattr(page, "measure", lambda data, piece: {"row": piece[1]})
    monkeypatch.setattr(page.provenance, "committed", lambda *paths: "abc1234")
    monkeypatch.setattr(page.provenance, "age", lambda commit, paths: 0)
    monkeypatch.setattr("sys.argv", ["real", SECTIONS[0].part, "--publish", "--kept", str(tmp_path / "kept")])
    monkeypatch.setattr(page, "each", lambda make, pieces, jobs, in_order: map(make, pieces))
    page.main()
    text = document.read_text()
    assert "| one |\n| two |" in text and "old" not in text and "`abc1234`" in text
    assert text.startswith("# Head") and text.endswith("Rest.\n")


def test_a_killed_run_goes_on_where_it_was(tmp_path, monkeypatch):
    """What was measured before the end is not measured again; another version of the code begins anew."""
    made = []

    def measure(data, label):
        made.append(label)
        if len(made) == 2:
            raise KeyboardInterrupt
        return {"row": label}

    section = counted(tmp_path, measure)
    monkeypatch.setattr("benchmarks.real.page.SECTIONS", [section])
    with pytest.raises(KeyboardInterrupt):
        list(page.sections([section], tmp_path, tmp_path / "kept", 1))
    ((_, table),) = page.sections([section], tmp_path, tmp_path / "kept", 1)
    assert (table, made) == ("| one |\n| two |", ["one", "two", "two"])
    list(page.sections([section], tmp_path, tmp_path / "other code", 1))
    assert made[3:] == ["one", "two"]


def test_the_page_is_written_whole_with_commit_and_rows_that_its_registry_knows(tmp_path, monkeypatch):
    """What --publish writes passes the test of published tables, and says commit, date and versions at its head."""
    written = tmp_path / "real.md"
    monkeypatch.setattr(page, "PAGE", written)
    monkeypatch.setattr(page, "PROJECT", tmp_path)
    monkeypatch.setattr(page.provenance, "committed", lambda: "0123abc")
    empty = tmp_path / "data"
    monkeypatch.setattr("sys.argv", ["real", "--publish", "--data", str(empty), "--kept", str(tmp_path / "kept")])
    page.main()
    text = written.read_text()
    assert "Commit `0123abc`" in text and "numpy" in text
    assert list(problems("real.md", text, TABLES, lambda commit, paths: 0)) == []


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.name)
def test_the_page_says_nothing_by_hand(section):
    """Ahead of each table stands what the program that writes the page says of it."""
    assert page.about(section) in page.PAGE.read_text(encoding="utf-8")


def test_a_packed_flight_is_read(tmp_path, monkeypatch):
    """A log that ends in .xz is unpacked for the reader, and nothing is left of it."""
    (tmp_path / "dive.BIN.xz").write_bytes(lzma.compress(b"a flight"))
    seen = []
    monkeypatch.setattr(ardusub, "read_flightlog", lambda path, vehicle: seen.append((path, path.read_bytes())))
    ardusub.read(tmp_path, "dive", load_vehicle("bluerov2"))
    ((path, content),) = seen
    assert content == b"a flight" and path.name == "dive.BIN" and not path.exists()
    assert ardusub.absent(ardusub.Case("dive", "other"), tmp_path, True) == f"{tmp_path} lacks other.BIN"


@pytest.fixture(scope="module")
def sound():
    """A flight of ArduSub's simulated vehicle by commands between dead band and what leaves room for larger ones."""
    vehicle, rng = load_vehicle(ardusub.VEHICLE), np.random.default_rng(0)
    commands = np.repeat(rng.uniform(0.1, 0.6, (1, 20, 8)) * rng.choice([-1.0, 1.0], (1, 20, 8)), 20, axis=1)
    return flown(vehicle, commands), vehicle


def flown(vehicle, commands, current=(0.0, 0.0, 0.0)):
    """The positions and attitudes of a vehicle that begins at rest in the water, as a log."""
    times = np.arange(commands.shape[1] + 1) / 20
    start = rest_state(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.array([[*current, 0, 0, 0]]), 8)
    reported = simulate(vehicle, commands, times, start).reported
    angles = np.stack(euler_angles(reported.quaternion[0, :-1]), axis=-1)
    pose = np.concatenate([reported.position[0, :-1], angles], axis=-1)
    episode = Episode(0, times[:-1], pose, np.full_like(pose, np.nan), commands[0])
    return FlightLog("flight", (episode,), AXES[:6])


@pytest.mark.parametrize(
    "case", [case for case in ardusub.ALTERED if case.alter and case.onset_s is None], ids=lambda case: case.name
)
def test_a_changed_log_is_that_of_the_vehicle_it_is_said_to_be(sound, case):
    """The simulator, with what a case says was wrong, flies the changed commands as the log says."""
    log, vehicle = sound
    changed = case.alter(log).episodes[0]
    effect = EFFECTS[case.effect]
    wrong = effect.apply(vehicle, effect.read(vehicle, case.truth))
    current = [case.truth.get(name, 0.0) for name in ("north", "east", "down")]
    again = flown(wrong, changed.commands[None], current).episodes[0]
    assert again.pose == pytest.approx(changed.pose, abs=1e-5)


def test_what_sets_in_late_leaves_what_was_before(sound):
    """From its moment on a change is the whole one, and before it there is none."""
    (before,), (whole,), (late,) = (
        log.episodes
        for log in (sound[0], altered.multiplied(3, -0.5)(sound[0]), altered.multiplied(3, -0.5, 8.0)(sound[0]))
    )
    sets_in = int(np.searchsorted(late.t, 8.0))
    assert np.array_equal(late.commands[:sets_in], before.commands[:sets_in])
    assert np.array_equal(late.commands[sets_in:], whole.commands[sets_in:])
    assert not np.array_equal(whole.commands, before.commands)


def test_more_than_full_command_is_refused(sound):
    """A log cannot have commands with which a thruster of a tenth would have pushed as a sound one did."""
    with pytest.raises(ValueError, match="thruster 2 .*take less"):
        altered.multiplied(2, 0.1)(sound[0])


def test_a_run_of_2016_is_read_as_its_mapping_says(tmp_path):
    """Outputs are held until they change, and stand in the order of the thrusters; rates are those of the sensors."""
    vehicle, run = load_vehicle(rov2016.VEHICLE), "test1_roll_pitch"
    t = np.arange(0, 4.0, 0.01)
    names = ("roll", "pitch", "yaw", "p", "q", "r", "depth", "a_x", "a_y", "a_z")
    columns = {name: np.round(0.1 * np.sin((1 + place) * t + place), 3) for place, name in enumerate(names)}
    columns["a_z"] -= 9.8
    lines = [",".join(["t", *(f"pwm_{n}" for n in range(1, 7)), *columns])]
    for row, at in enumerate(t):
        sent = [str(1500 + 40 * n * (-1) ** (row // 20)) if row % 20 == 0 else "" for n in range(1, 7)]
        lines.append(",".join([f"{at:.3f}", *sent, *(f"{column[row]:.3f}" for column in columns.values())]))
    (tmp_path / f"{rov2016.RUNS[run][0]}.csv.xz").write_bytes(lzma.compress("\n".join(lines).encode()))
    log = rov2016.read(tmp_path, run, vehicle)
    assert {"roll", "pitch", "yaw", "p", "q", "r"} <= set(log.axes)
    command = np.concatenate([episode.commands for episode in log.episodes])
    assert np.abs(command).max(0) == pytest.approx(np.arange(1, 7) / 10, abs=1e-6)


@pytest.mark.parametrize(
    ("pointed", "broken", "right"),
    [
        (rov2016.Pointed("partly_explained", "", 6, {6: 0.1}), 6, True),
        (rov2016.Pointed("partly_explained", "", 6, {}), 6, True),
        (rov2016.Pointed("partly_explained", "", 6, {5: 0.1}), 6, False),
        (rov2016.Pointed("unexplained", "", None, {}), 6, False),
        (rov2016.Pointed("unexplained", "", None, {}), None, True),
        (rov2016.Pointed("unexplained", "", 1, {}), None, False),
        (rov2016.Pointed("explained", "", 1, {1: 0.0}), None, False),
    ],
)
def test_a_run_is_right_that_points_at_no_sound_thruster(pointed, broken, right):
    """With a broken propeller it must point at that one, too."""
    assert pointed.is_right(broken) is right


def named(effect, probability=0.9, calibrates=False):
    """An effect that a diagnosis tells of."""
    return SimpleNamespace(name=effect, probability=probability, calibrates=calibrates)


@pytest.mark.parametrize(
    ("effects", "where", "verdict", "doubt", "alarms"),
    [
        ((), {}, Verdict.CANNOT_TELL, "", ()),
        ((named("hull", calibrates=True),), {}, Verdict.PARTLY_EXPLAINED, "", ()),
        ((named("thruster_gain"),), {}, Verdict.EXPLAINED, "", ("thruster_gain",)),
        ((named("thruster_gain", 0.3),), {}, Verdict.EXPLAINED, "", ()),
        ((), {3: 1.0}, Verdict.UNEXPLAINED, "", ("thruster 3 pushes otherwise than commanded",)),
        ((), {3: 1.0}, Verdict.CANNOT_TELL, "", ()),
        ((), {}, Verdict.UNEXPLAINED, "unit", ("clock",)),
        ((), {}, Verdict.UNEXPLAINED, "clock", ()),
    ],
)
def test_an_alarm_is_what_names_a_fault_that_nothing_bears(effects, where, verdict, doubt, alarms):
    """Neither a file that is corrected, nor what is less likely than not, nor a doubt that the parameters bear."""
    located = SimpleNamespace(thruster=where, intermittence=None, thrust_map=None)
    findings = (Finding(Severity.WARNING, "clock", "the clock may be off", limits=True),)
    findings = findings if verdict is Verdict.UNEXPLAINED and not where else ()
    found: Any = SimpleNamespace(effects=effects, where=located, verdict=verdict, findings=findings)
    assert orca.alarms_of(found, doubt) == alarms


@pytest.mark.parametrize(("motor", "borne"), [(3, True), (4, False)])
def test_the_direction_of_a_motor_that_was_set_bears_that_its_thruster_pushes_otherwise(motor, borne):
    """Of that motor, and of no other one."""
    located = SimpleNamespace(thruster={3: 1.0}, intermittence=None, thrust_map=None)
    findings = (Finding(Severity.WARNING, "set", f"MOT_{motor}_DIRECTION was set from 1 to -1 at 34.3 s"),)
    found: Any = SimpleNamespace(effects=(), where=located, verdict=Verdict.UNEXPLAINED, findings=findings)
    assert (orca.alarms_of(found) == ()) is borne


@pytest.mark.parametrize(("share", "at_rest", "dead"), [(0.0, -0.07, 1), (0.0, 0.0, 1), (1.0, -0.07, 0), (0.6, 0.0, 0)])
def test_a_thruster_that_answers_no_command_is_called_dead(share, at_rest, dead):
    """Whether it pushes all the time or never; not one that pushes at rest, or is weak."""
    slices = tuple(Slice(0.1 * k, 0.1 * k + 0.1, share, share - 0.05, share + 0.05) for k in range(1, 4))
    measured = ThrustMap(1, slices, at_rest, at_rest - 0.01, at_rest + 0.01)
    where = SimpleNamespace(thruster={1: 1.0}, intermittence=None, thrust_map=measured)
    found: Any = SimpleNamespace(effects=(), where=where, verdict=Verdict.PARTLY_EXPLAINED, headline="", findings=())
    assert len(orca.dead_of(found)) == dead and len(orca.alarms_of(found)) == 1


def test_logs_without_a_dive_are_refused_and_a_missing_one_is_named(tmp_path, monkeypatch):
    """What is refused as no dive is right where there is none, and wrong of a dive; the folder is unpacked and gone."""
    assert "orca_bluerov2" in orca.missing(tmp_path, "2023-05-20") and "small.BIN" in orca.missing(tmp_path, orca.ALL)
    for held in orca.LOGS.values():
        (tmp_path / held.file).parent.mkdir(exist_ok=True)
        (tmp_path / held.file).write_bytes(lzma.compress(b"a log") if held.file.endswith(".xz") else b"a log")
    seen = []

    def refuse(path, vehicle):
        seen.append((path, path.read_bytes()))
        raise FlightLogError(f"{path.name} holds no dive: no thruster turns in it")

    monkeypatch.setattr(orca, "read_flightlog", refuse)
    rows = [orca.measure(tmp_path, label)["row"] for label in orca.LOGS]
    assert [row[-2] for row in rows] == ["yes", "yes", "yes", "no", "no"]
    assert all(content == b"a log" and not path.exists() for path, content in seen)
    *_, told = orca.table({"row": row} for row in rows)
    assert told.startswith("3 of 5 right. In 0 of 5 logs a thruster is called dead")


@pytest.mark.parametrize(
    ("position", "said", "named", "right"),
    [
        ("/mavros/global_position/local", "a holds no dive: no thruster turns in it", (), True),
        ("/mavros/global_position/local", "The vehicle does not move at all, whatever is commanded.", (), True),
        ("/mavros/global_position/local", "The file may be off.", (), False),
        ("/mavros/global_position/local", "The vehicle does not move at all.", ("thruster_gain",), False),
        ("/mocap/sam_mocap/odom", "a holds no dive: no thruster turns in it", (), False),
        ("", "a holds no dive: no thruster turns in it", (), False),
    ],
)
def test_a_bag_in_which_nothing_moves_is_right_by_what_is_read_and_said(position, said, named, right):
    """Of this vehicle, that nothing moves, and no fault."""
    sources = {"outputs": "/mavros/rc/out", "position": position, "gyro": "/mavros/imu/data"}
    assert saab.is_right(sources, said, named) is right


def test_the_bag_of_the_tank_is_read_and_told_right():
    """As its owners recorded it."""
    metadata = shared(f"{saab.FOLDER}/{saab.RUN}/metadata.yaml.xz")
    row = saab.measure(metadata.parents[2], saab.RUN)["row"]
    assert row[-2] == "yes" and row[2] == "/mavros/global_position/local"
