"""The extension for BlueOS by its parts: labels, light, odometer, watch and server. Docker is not here."""

import json
import os
import re
import shutil
import sys
import time
from pathlib import Path

import pytest
from auv_light.armed import is_armed
from auv_light.dives import Dives
from auv_light.light import Light, light_of
from auv_light.odometer import add, work
from auv_light.odometer import main as odometer
from auv_light.watch import QUIET_S, UNKNOWN_S, Watch

from auv_torchrl import __version__
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.paths import PROJECT
from tests.flightlog.dataflash_writer import ALL
from tests.flightlog.test_other_recordings import mcap_file
from tests.page.conftest import needs_extra

EXTENSION = PROJECT / "extension"
DOCKERFILE = (EXTENSION / "Dockerfile").read_text()
ARDUSUB = PROJECT / "tests" / "flightlog" / "data" / "ardusub.BIN"
PROGRAM = (sys.executable, str(Path(__file__).with_name("standin.py")))
AT_ONCE = (sys.executable, "-m", "auv_torchrl.page.child", "0")  # behind nobody, as the watch would have it
NOW = 1_800_000_000.0


def labels():
    """The labels of the image, JSON where they are."""
    joined = DOCKERFILE.replace("\\\n", "")
    found = dict(re.findall(r"^LABEL (\w+)=(?:'(.*)'|\".*\")$", joined, re.M))
    plain = dict(re.findall(r'^LABEL (\w+)="(.*)"$', joined, re.M))
    return {name: json.loads(value) if value else plain[name] for name, value in found.items()}


def test_the_labels_are_those_that_the_store_asks_for():
    """The log folder is read-only, the container has one core and 600 MB, and the version is that of the package."""
    told = labels()
    wanted = "version type tags requirements readme links authors company permissions"
    assert set(told) == set(wanted.split()) and told["version"] == __version__
    assert told["type"] in ("device-integration", "example", "theme", "tool", "other")
    assert all(re.fullmatch(r"[a-z-]+", tag) for tag in told["tags"]) and len(told["tags"]) <= 10
    assert all({"name", "email"} <= set(person) for person in [*told["authors"], told["company"]])
    host = told["permissions"]["HostConfig"]
    bound = [bind.split(":") for bind in host["Binds"]]
    assert {inside: mode for _, inside, mode in bound if inside.startswith("/logs")} == {
        "/logs/autopilot": "ro", "/logs/recorder": "ro",
    }  # fmt: skip
    assert host["CpuQuota"] == host["CpuPeriod"] and host["Memory"] == 600 * 2**20 and "Privileged" not in host
    (port,) = told["permissions"]["ExposedPorts"]
    assert (
        list(host["PortBindings"]) == [port] and f"EXPOSE {port}" in DOCKERFILE and f"AUV_PORT={port[:4]}" in DOCKERFILE
    )


def test_all_that_the_image_copies_is_there_and_let_through():
    """What is copied stands in the checkout; the wheel is built from what the ignore file lets through."""
    for source in re.findall(r"^COPY (?!--from)(\S+)", DOCKERFILE, re.M):
        assert (PROJECT / source).exists()
    let = re.findall(r"^!(\S+)", (EXTENSION / "Dockerfile.dockerignore").read_text(), re.M)
    assert all(list(PROJECT.glob(name)) for name in let) and {"pyproject.toml", "README.md", "LICENSE", "conf"} <= set(
        let
    )


def effect(name, probability, **gains):
    return {"name": name, "probability": probability, "parameters": {key: {"value": v} for key, v in gains.items()}}


@pytest.mark.parametrize(
    ("verdict", "effects", "light"),
    [
        ("no_gap", [], Light.SOUND),
        ("cannot_tell", [], Light.LOOK),
        ("unexplained", [], Light.LOOK),
        ("explained", [effect("thruster_gain", 0.99, gain_4=0.55)], Light.LOOK),
        ("explained", [effect("thruster_gain", 0.99, gain_4=-1.0)], Light.STOP),
        ("explained", [effect("thruster_gain", 0.99, gain_4=0.0)], Light.STOP),
        ("explained", [effect("thruster_gain", 0.6, gain_4=0.0)], Light.LOOK),
        ("partly_explained", [effect("payload", 1.0, mass=2.0), effect("thruster_swap", 0.95, pair=3)], Light.STOP),
    ],
)
def test_a_verdict_becomes_a_light(verdict, effects, light):
    """Red is what must not be flown with, at a probability that is said."""
    assert light_of({"verdict": verdict, "effects": effects}) is light


def test_the_odometer_counts_hours_and_starts(tmp_path):
    """Of a table whose numbers are known, of a log of ArduSub, and of one without commands."""
    rows = [f"{n * 0.5},0,0,0,0,{0.5 if 4 <= n < 11 else 0},{-1 if n % 2 else 0.01}" for n in range(21)]
    path = tmp_path / "dive.csv"
    path.write_text("t,x,y,z,yaw,cmd_1,cmd_2\n" + "\n".join(rows) + "\n")
    one, two = work(path)
    assert one == {"hours": pytest.approx(3.5 / 3600), "full_hours": pytest.approx(0.875 / 3600), "starts": 1}
    assert two["starts"] == 10 and two["hours"] == pytest.approx(5.0 / 3600)
    assert add([one], [one, two])[0]["hours"] == pytest.approx(7.0 / 3600) and add([one], [one, two])[1] == two
    assert len(work(ARDUSUB)) >= 6
    path.write_text("t,x\n0,1\n1,2\n")
    with pytest.raises(FlightLogError, match="no commands of thrusters"):
        work(path)


class Autopilot:
    """Says what it is told to say."""

    def __init__(self, armed=False):
        self.armed = armed

    def __call__(self):
        return self.armed


@pytest.fixture
def watch(tmp_path):
    """Over a folder with two dives, one a day old and one that came to rest a minute ago; stand-ins do the work."""
    logs = tmp_path / "logs"
    (logs / "autopilot").mkdir(parents=True)
    for name, age in (("00000001.BIN", 86400.0), ("00000002.BIN", 60.0)):
        put(logs, name, age)
    return Watch(Dives(logs, tmp_path / "kept"), "bluerov2", Autopilot(), lambda: NOW, PROGRAM)


def put(logs, name, age_s):
    path = logs / "autopilot" / name
    path.write_bytes(name.encode())
    os.utime(path, (NOW - age_s, NOW - age_s))
    return path


def test_the_newest_dive_is_diagnosed_against_those_marked_sound(watch):
    """And the log folder stays as it was."""
    before = {path: path.read_bytes() for path in watch.dives.logs.rglob("*.BIN")}
    assert watch.step()
    newest, oldest = watch.dives
    assert (newest.name, newest.light, newest.against, oldest.light) == ("00000002.BIN", "stop", [], "")
    oldest.sound = True
    watch.again()
    assert watch.step()
    assert newest.against == ["00000001.BIN"] and newest.summary == "Thruster 4 is reversed."
    words = json.loads((watch.dives.results(newest) / "diagnosis.json").read_text())["words"]
    assert words[words.index("--healthy") + 1].endswith("00000001.BIN")
    while watch.step():
        pass
    assert [len(dive.thrusters) for dive in watch.dives] == [2, 2] and watch.doing == "waiting for a dive"
    assert {path: path.read_bytes() for path in watch.dives.logs.rglob("*") if path.is_file()} == before
    again = Dives(watch.dives.logs, watch.dives.kept)
    assert [vars(dive) for dive in again] == [vars(dive) for dive in watch.dives]


def test_nothing_is_done_while_the_vehicle_is_armed(watch):
    """Nor of a log that has changed just now; where nobody says whether it is armed, longer."""
    watch.armed.armed = True
    assert not watch.step() and "armed" in watch.doing and not list(watch.dives)
    watch.armed.armed = None
    put(watch.dives.logs, "00000002.BIN", UNKNOWN_S - 5)
    watch.step()
    assert [dive.name for dive in watch.dives] == ["00000001.BIN"]
    watch.armed.armed = False
    put(watch.dives.logs, "00000003.BIN", QUIET_S - 5)
    watch.dives.look(NOW - QUIET_S)
    assert [dive.name for dive in watch.dives] == ["00000002.BIN", "00000001.BIN"]


def record(logs, name, age_s):
    """A file that the recorder of BlueOS ended some time ago."""
    path = logs / "recorder" / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(name.encode())
    os.utime(path, (NOW - age_s, NOW - age_s))


def named(age_s):
    """As the recorder names what it begins some time ago, in UTC."""
    return time.strftime("recorder_%Y%m%d_%H%M%S.mcap", time.gmtime(NOW - age_s))


@pytest.mark.parametrize(
    ("log_age_s", "begun_age_s", "is_taken"),
    [(None, 900.0, True), (1000.0, 900.0, True), (250.0, 900.0, False), (0.0, 900.0, False), (1000.0, None, False)],
    ids=["no log", "a log of an earlier dive", "a log of the same dive", "a log that goes on", "begun who knows when"],
)
def test_a_recording_is_a_dive_where_the_autopilot_logged_none(tmp_path, log_age_s, begun_age_s, is_taken):
    """A log of the autopilot that was written to since the recording began holds the same dive, and better."""
    logs = tmp_path / "logs"
    (logs / "autopilot").mkdir(parents=True)
    if log_age_s is not None:
        put(logs, "00000001.BIN", log_age_s)
    record(logs, "dive.mcap" if begun_age_s is None else named(begun_age_s), 300.0)
    dives = Dives(logs, tmp_path / "kept")
    dives.look(NOW - QUIET_S)
    assert [dive.is_recording for dive in dives].count(True) == is_taken


def test_the_name_of_a_recording_may_be_any(tmp_path):
    """Digits that are no time are a time that nobody knows: it is taken where no log of the autopilot is."""
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("recorder_99999999_999999.mcap", "a.MCAP", "recorder_00000000_000000.mcap"):
        record(logs, name, 300.0)
    dives = Dives(logs, tmp_path / "kept")
    dives.look(NOW - QUIET_S)
    assert len(list(dives)) == 3 and all(dive.is_recording for dive in dives)


def test_a_recording_is_held_against_recordings_with_the_parameters_that_it_lacks(tmp_path):
    """A log of the autopilot has sensors that a recording has not, and its own parameters."""
    logs, kept = tmp_path / "logs", tmp_path / "kept"
    (logs / "autopilot").mkdir(parents=True)
    put(logs, "00000001.BIN", 86400.0)
    record(logs, named(50_000.0), 49_000.0)
    record(logs, named(900.0), 300.0)
    parameters = tmp_path / "vehicle.param"
    watch = Watch(Dives(logs, kept), "bluerov2", Autopilot(), lambda: NOW, PROGRAM, parameters)
    watch.dives.look(NOW - QUIET_S)
    newest, older, oldest = watch.dives
    older.sound = oldest.sound = True
    for given in (False, True):
        if given:
            parameters.write_text("SERVO1_FUNCTION,33\n")
        watch.again()
        assert watch.step() and newest.against == [older.name]
        words = json.loads((watch.dives.results(newest) / "diagnosis.json").read_text())["words"]
        assert ("--params" in words) is given and Path(words[words.index("--healthy") + 1]).name == older.name
        assert not given or words[words.index("--params") + 1] == str(parameters)


def test_the_odometer_reads_a_recording(tmp_path, capsys, monkeypatch):
    """With the parameters that it lacks beside it: thruster 2 turned for as long as the vehicle was armed."""
    lacking = mcap_file(tmp_path / named(900.0), given={})
    parameters = tmp_path / "vehicle.param"
    parameters.write_text("".join(f"{name},{value}\n" for name, value in ALL.items()))
    for words in ([str(lacking)], [str(lacking), str(parameters)]):
        monkeypatch.setattr(sys, "argv", ["odometer", *words])
        odometer()
    without, thrusters = map(json.loads, capsys.readouterr().out.splitlines())
    assert "SERVO" in without["error"] or "FRAME_CONFIG" in without["error"]
    assert thrusters["thrusters"][1]["hours"] == pytest.approx(9.0 / 3600, rel=0.05)
    assert thrusters["thrusters"][0]["hours"] == 0


def test_a_diagnosis_is_ended_when_the_vehicle_is_armed(watch):
    """And begins anew after the dive."""
    put(watch.dives.logs, "slow.BIN", QUIET_S + 1)
    asked = iter([False, True])
    watch.armed = lambda: next(asked, True)
    assert watch.step()
    assert not next(iter(watch.dives)).is_diagnosed


def test_a_log_that_is_of_no_use_says_so(watch):
    """In the words of the diagnosis, and is not tried again."""
    put(watch.dives.logs, "broken.BIN", QUIET_S + 1)
    assert watch.step()
    newest = next(iter(watch.dives))
    assert (newest.light, newest.summary) == ("", "this log is of no use") and newest.is_diagnosed


@pytest.fixture
def client(watch):
    """A client of the server, which looks for no work by itself."""
    needs_extra()
    testclient = pytest.importorskip("fastapi.testclient")
    from auv_light.app import make_app

    with testclient.TestClient(make_app(watch, every_s=0)) as made:
        made.watch = watch
        yield made


def test_the_server_says_who_it_is_and_serves_below_any_path(client):
    """BlueOS registers it by that answer, and Cockpit its widget; no path of the page begins with a slash."""
    told = client.get("/register_service").json()
    assert (
        told["works_in_relative_paths"] is True and told["version"] == __version__ and told["icon"].startswith("mdi-")
    )
    (widget,) = client.get(told["extras"]["cockpit"]).json()["widgets"]
    for path in ("/", widget["iframe_url"]):
        page = client.get(path)
        assert page.status_code == 200 and "default-src 'none'" in page.headers["content-security-policy"]
        assert not re.findall(r'(?:src|href)="(?:/|[a-z]+:)', page.text)
    script = client.get("/light.js").text
    assert not re.findall(r"fetch\([\"`']/", script) and "innerHTML" not in script


def test_a_dive_is_marked_and_its_report_read(client):
    """By a page of ours alone; the report runs in a sandbox."""
    client.watch.step()
    newest, oldest = client.get("/status").json()["dives"]
    assert client.get("/status").json()["newest"] == {
        "light": "stop", "summary": "Thruster 4 is reversed.", "name": "00000002.BIN",
    }  # fmt: skip
    report = client.get(f"/dives/{newest['id']}/report")
    assert "sandbox" in report.headers["content-security-policy"] and "reversed" in report.text
    assert client.get(f"/dives/{oldest['id']}/report").status_code == 404
    path = f"/dives/{oldest['id']}/sound"
    assert client.post(path, params={"sound": True}).status_code == 403
    assert client.post(path, params={"sound": True}, headers={"x-auv-light": "1"}).json() == {"sound": True}
    assert client.get("/status").json()["newest"]["light"] == ""  # held against it next
    assert client.post("/dives/../sound", params={"sound": True}, headers={"x-auv-light": "1"}).status_code in (
        404,
        405,
    )
    assert client.get("/dives/none/report").status_code == 404


def test_who_does_not_answer_leaves_open_whether_it_is_armed():
    """No service, and no address at all."""
    assert is_armed("http://127.0.0.1:9") is None and is_armed("nowhere") is None


@pytest.mark.slow
@pytest.mark.thorough
def test_a_log_of_ardusub_gets_its_answer(tmp_path):
    """By the real diagnosis, in the process that goes on for as long as the watch waits for it."""
    (tmp_path / "logs").mkdir()
    shutil.copy(ARDUSUB, tmp_path / "logs" / "00000001.BIN")
    watch = Watch(Dives(tmp_path / "logs", tmp_path / "kept"), "bluerov2_heavy", Autopilot(), lambda: NOW * 2, AT_ONCE)
    assert watch.step() and watch.step()
    (dive,) = watch.dives
    assert dive.is_diagnosed and len(dive.thrusters) == 8
