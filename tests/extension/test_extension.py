"""The extension for BlueOS by its parts: labels, light, odometer, watch and server. Docker is not here."""

import json
import os
import re
import shutil
import sys
from pathlib import Path

import pytest
from auv_light.armed import is_armed
from auv_light.dives import Dives
from auv_light.light import Light, light_of
from auv_light.odometer import add, work
from auv_light.watch import QUIET_S, UNKNOWN_S, Watch

from auv_torchrl import __version__
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.paths import PROJECT
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
    assert [bind.rsplit(":", 1)[1] for bind in host["Binds"] if bind.split(":")[1].startswith("/logs")] == ["ro"]
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
