"""Work over many dives: found in folders, put in order, kept, gone on with, and apart from that of other versions."""

import os
import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from omegaconf import OmegaConf

from auv_torchrl.diagnosis.command.logs import is_series, logs_of
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.flightlog import write_flightlog
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.streams.configuration import changed_in_flight
from auv_torchrl.flightlog.streams.stream import ReadOptions
from auv_torchrl.monitoring import dive_work
from auv_torchrl.monitoring.dive_job import begun, plan_dives
from auv_torchrl.monitoring.dive_record import Dive
from auv_torchrl.monitoring.dive_work import Work, follow_all
from auv_torchrl.vehicle import load_vehicle
from tests.command_lines import answers_of
from tests.diagnosis.flown_logs import fly, hold
from tests.diagnosis.stuck_channels import rocked
from tests.monitoring.many_dives import BASELINE, PARAMETERS, dives_of, fading


def config(**given):
    return OmegaConf.create({"log": None, "healthy": [], "test": [], "dives": False, "reference": 3, **given})


def folder_of(path, *names):
    path.mkdir(parents=True, exist_ok=True)
    for name in names:
        (path / name).write_text(f"t,x\n{name}\n")
    return path


@pytest.fixture
def dives(tmp_path):
    return folder_of(tmp_path / "dives", *(f"dive_{i}.csv" for i in range(1, 12)))


@pytest.fixture
def followed(monkeypatch):
    """The names of the dives that were followed, each of which tells what its number says."""
    by_name = {dive.name: dive for dive in dives_of(fading(8))}
    names = []

    def follow_dive(path, reference, begun):
        names.append(path.name)
        return by_name[path.name]

    monkeypatch.setattr(dive_work, "follow_dive", follow_dive)
    monkeypatch.setattr(dive_work, "learn_reference", lambda *_: type("Reference", (), {"baseline": BASELINE}))
    monkeypatch.setattr(Work, "read", lambda self, path: flight_of(path))
    return names


def flight_of(path, *findings):
    """Of a log, what following it needs here."""
    return SimpleNamespace(name=path.name, findings=findings)


def work_in(folder, **changed):
    given = {"vehicle": load_vehicle("paper"), "vehicle_name": "paper", "settings": load_settings(), "uncertainty": ()}
    given |= {"extra": (), "options": ReadOptions((), {}), "trust_log": False, "shaped_by": {}, "jobs": 1}
    return Work(**{**given, "store": folder, **changed})


def test_a_folder_holds_dives_and_a_list_one_log(dives):
    """A folder is a series in the order of counting; a list is one log, unless dives are asked for."""
    assert is_series(config(log=str(dives)))
    assert [path.name for path in logs_of(config(log=str(dives)))] == [f"dive_{i}.csv" for i in range(1, 12)]
    both = [str(dives / "dive_2.csv"), str(dives / "dive_1.csv")]
    assert not is_series(config(log=both))
    assert is_series(config(log=both, dives=True))
    assert [path.name for path in logs_of(config(log=both))] == ["dive_2.csv", "dive_1.csv"]


def test_a_bag_is_one_log(tmp_path):
    """A folder that is a bag of ROS 2 is no folder of dives, and may be one of them."""
    bag = folder_of(tmp_path / "runs" / "one", "metadata.yaml")
    assert not is_series(config(log=str(bag)))
    assert logs_of(config(log=str(tmp_path / "runs"))) == (bag,)


def test_a_folder_without_logs_is_refused(tmp_path):
    """One line says which folder holds none, and what would be one."""
    with pytest.raises(FlightLogError, match=r"empty.*no log.*\.csv"):
        logs_of(config(log=str(folder_of(tmp_path / "empty", "notes.txt"))))


def test_dates_in_names_put_dives_in_order(tmp_path):
    """Where every name has a date, that is the order; the time of day counts."""
    names = ("b_2026-03-02.csv", "a_20260302_1430.csv", "c_2026-02-28 08-15-00.csv")
    folder = folder_of(tmp_path / "dated", *names)
    planned = plan_dives(config(log=str(folder), reference=1))
    assert [path.name for path in planned.paths] == [names[2], names[0], names[1]]
    assert planned.begun == ("2026-02-28 08:15", "2026-03-02", "2026-03-02 14:30")
    assert begun(Path("dive_20269999.csv")) == ""


def test_healthy_logs_are_the_reference(dives):
    """They come first, and are not counted twice where they lie in the folder."""
    sound = [str(dives / "dive_4.csv"), str(dives / "dive_5.csv")]
    planned = plan_dives(config(log=str(dives), healthy=sound))
    assert planned.reference == 2
    assert [path.stem[5:] for path in planned.paths] == ["4", "5", "1", "2", "3", "6", "7", "8", "9", "10", "11"]


def test_too_few_dives_are_refused(dives):
    """A reference that leaves no dive to judge is refused, and so are keys of a single log."""
    with pytest.raises(ValueError, match="11 dives, and the reference is 11 of them"):
        plan_dives(config(log=str(dives), reference=11))
    with pytest.raises(ValueError, match="give 1 dive or more"):
        plan_dives(config(log=str(dives), reference=0))
    with pytest.raises(ValueError, match="test="):
        plan_dives(config(log=str(dives), test="a.csv"))


def test_a_killed_run_goes_on(dives, followed, tmp_path, monkeypatch):
    """After a kill in the fifth dive, the rest is done and no more; a third run does nothing, with the same answer."""
    mine, planned = work_in(tmp_path / "store"), plan_dives(config(log=str(dives)))
    whole = dive_work.follow_dive

    def killed(path, reference, begun):
        if len(followed) == 4:
            raise KeyboardInterrupt
        return whole(path, reference, begun)

    monkeypatch.setattr(dive_work, "follow_dive", killed)
    with pytest.raises(KeyboardInterrupt):
        follow_all(mine, planned, lambda *_: None)
    monkeypatch.setattr(dive_work, "follow_dive", whole)
    baseline, first = follow_all(mine, planned, lambda *_: None)
    assert followed == [f"dive_{i}.csv" for i in range(1, 12)]
    again, second = follow_all(mine, planned, lambda *_: None)
    assert len(followed) == 11
    assert again.parameters == baseline.parameters == PARAMETERS
    for one, other in zip(first, second, strict=True):
        assert (one.name, one.noise, one.excess) == (other.name, other.noise, other.excess)
        assert (one.A == other.A).all() and (one.h == other.h).all()


def test_answers_of_another_version_are_kept_apart(dives, followed, tmp_path, monkeypatch):
    """Another program, other settings, another reference or another log has its own answers."""
    mine, planned = work_in(tmp_path / "store"), plan_dives(config(log=str(dives)))
    follow_all(mine, planned, lambda *_: None)
    follow_all(work_in(tmp_path / "store", shaped_by={"vehicle": "heavier"}), planned, lambda *_: None)
    assert len(followed) == 22
    follow_all(mine, plan_dives(config(log=str(dives), reference=4)), lambda *_: None)
    assert len(followed) == 33
    (dives / "dive_9.csv").write_text("t,x\nflown again\n")
    follow_all(mine, planned, lambda *_: None)
    assert followed[33:] == ["dive_9.csv"]
    monkeypatch.setattr(dive_work, "program", lambda: "another")
    follow_all(mine, planned, lambda *_: None)
    assert len(followed) == 45


def test_a_damaged_answer_is_worked_out_again(dives, followed, tmp_path):
    """A file of the store that cannot be read is not believed."""
    mine, planned = work_in(tmp_path / "store"), plan_dives(config(log=str(dives)))
    follow_all(mine, planned, lambda *_: None)
    (tmp_path / "store" / f"dive_{mine.key(planned, planned.paths[4])}.json").write_text("{")
    follow_all(mine, planned, lambda *_: None)
    assert followed[11:] == ["dive_5.csv"]


def broken(monkeypatch, *names):
    """Reading these dives fails."""

    def read(self, path):
        if path.name in names:
            raise FlightLogError(f"{path.name} has no column t")
        return flight_of(path)

    monkeypatch.setattr(Work, "read", read)


def test_a_dive_that_cannot_be_used_does_not_end_the_run(dives, followed, tmp_path, monkeypatch):
    """It keeps its number and the reason, also as one of the reference, which is then the rest; the next goes on."""
    broken(monkeypatch, "dive_2.csv", "dive_7.csv")
    given = []
    monkeypatch.setattr(
        dive_work, "learn_reference", lambda logs, *_: given.extend(logs) or SimpleNamespace(baseline=BASELINE)
    )
    mine, planned = work_in(tmp_path / "store"), plan_dives(config(log=str(dives)))
    for _ in range(2):
        _, found = follow_all(mine, planned, lambda *_: None)
        assert {dive.name: dive.refused for dive in found if dive.refused} == {
            name: f"{name} has no column t" for name in ("dive_2.csv", "dive_7.csv")
        }
    assert [path.name for path in given] == ["dive_1.csv", "dive_3.csv"]
    assert len(followed) == 9


def test_a_log_during_which_a_direction_was_set_is_no_reference(dives, tmp_path, monkeypatch):
    """The vehicle was another one before; as a dive it is followed."""
    (found,) = changed_in_flight(np.array([0.0, 9.0]), ["MOT_1_DIRECTION"] * 2, np.array([1.0, -1.0]))
    set_late = {"dive_2.csv": [found]}
    monkeypatch.setattr(Work, "read", lambda self, path: flight_of(path, *set_late.get(path.name, [])))
    logs, refusals = work_in(tmp_path / "store").read_reference(plan_dives(config(log=str(dives))))
    assert [log.name for log in logs] == ["dive_1.csv", "dive_3.csv"]
    assert refusals == [f"dive_2.csv is no reference: {found.sentence}"]


@pytest.mark.parametrize(("held", "cause"), [(False, "no thruster turns"), (True, "does not move with its commands")])
def test_a_log_of_a_vehicle_on_deck_is_no_dive(tmp_path, held, cause):
    """Neither with idle thrusters nor with turning ones."""
    vehicle = hold(load_vehicle("bluerov2"))
    log = rocked(fly(vehicle, {}, seed=2, episodes=1, seconds=40.0))
    if not held:
        log = replace(log, episodes=tuple(replace(one, commands=0.05 * one.commands) for one in log.episodes))
    write_flightlog(log, tmp_path / "deck.csv")
    with pytest.raises(FlightLogError, match=f"deck.* holds no dive: .*{cause}"):
        work_in(tmp_path / "store", vehicle=vehicle, trust_log=True).read(tmp_path / "deck.csv")


def test_without_a_dive_that_can_be_used_the_run_ends(dives, followed, tmp_path, monkeypatch):
    """One error says why: of the reference, or of all that is behind it."""
    planned = plan_dives(config(log=str(dives)))
    broken(monkeypatch, "dive_1.csv", "dive_2.csv", "dive_3.csv")
    with pytest.raises(FlightLogError, match=r"no dive of the reference.*dive_1\.csv has no column t"):
        follow_all(work_in(tmp_path / "one"), planned, lambda *_: None)
    broken(monkeypatch, *(f"dive_{i}.csv" for i in range(4, 12)))
    with pytest.raises(FlightLogError, match=r"no dive behind the reference.*dive_4\.csv has no column t"):
        follow_all(work_in(tmp_path / "two"), planned, lambda *_: None)


def test_whatever_lies_in_a_folder_of_dives_is_a_dive_or_is_listed(tmp_path):
    """Links to nothing and to themselves, empty and foreign files are dives that are refused; the rest is listed."""
    folder = folder_of(tmp_path / "dives", "a.csv", "b.csv", "notes.txt", "flown.BIN", "packed.csv.gz")
    (folder / "empty.csv").touch()
    (folder / "loop.csv").symlink_to(folder / "loop.csv")
    (folder / "gone.BIN").symlink_to(folder / "nowhere.BIN")
    (folder / "photos").mkdir()
    (folder / "folder.csv").mkdir()
    os.mkfifo(folder / "pipe.csv")
    planned, mine = plan_dives(config(log=str(folder), reference=1)), work_in(tmp_path / "store")
    names = [path.name for path in planned.paths]
    assert names == ["a.csv", "b.csv", "empty.csv", "flown.BIN", "gone.BIN", "loop.csv", "packed.csv.gz", "pipe.csv"]
    (left_out,) = planned.findings
    for entry in ("notes.txt (not named as a log)", "photos (a folder)", "folder.csv (a folder)"):
        assert entry in left_out.sentence
    for path in planned.paths[1:]:
        assert mine.key(planned, path)
        with pytest.raises(FlightLogError):
            mine.read(path)


def test_what_other_processes_get_can_be_sent(tmp_path):
    """Work and dives survive being sent to another process."""
    mine = pickle.loads(pickle.dumps(work_in(tmp_path)))
    assert mine.vehicle.thrusters == 6
    dive = Dive.unread("a.csv", "why", 3)
    assert pickle.loads(pickle.dumps(dive)).refused == "why"


def test_the_command_tells_of_dives(tmp_path):
    """--help says how dives are given, and bad input is one line."""
    empty = folder_of(tmp_path / "empty", "notes.txt")
    one = folder_of(tmp_path / "one", "dive_1.csv")
    lines = {
        "help": ["--help"],
        "empty": [f"log={empty}", f"output={tmp_path / 'a'}"],
        "few": [f"log={one}", f"output={tmp_path / 'b'}"],
        "each": [f"log={folder_of(tmp_path / 'two', '1.csv', '2.csv')}", "reference=1", "each=some",
                 f"output={tmp_path / 'c'}"],
    }  # fmt: skip
    found = answers_of("diagnose", lines)
    for word in ("auv-diagnose FOLDER", "--dives", "--reference 3", "--each changed", "--dives-per-false-alarm"):
        assert word in found["help"][1]
    for case, word in (("empty", "holds no log"), ("few", "give more"), ("each", "changed, all or none")):
        code, _, err = found[case]
        assert code == 2, case
        assert word in err
        assert err.count("\n") == 1
