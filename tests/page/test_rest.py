"""The interface for programs: from a dropped log to a verdict, and what is refused."""

import asyncio
import json
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from auv_torchrl.page.store import JobState, Store
from auv_torchrl.paths import PROJECT
from tests.page.conftest import another, dropped, needs_extra, over, serving, until


def test_a_dropped_log_is_recognised_and_a_vehicle_is_proposed(client):
    """Frame, thrusters, axes and what auv-log info says; the same content again is the same dive."""
    content = another()
    log = dropped(client, content=content)
    assert (log["state"], log["vehicle"]) == ("ready", "paper")
    assert log["about"]["thrusters"] == 6 and log["about"]["axes"] == ["x", "y", "z", "yaw"]
    assert any("heading in rad" in line for line in log["about"]["lines"])
    again = client.post("/logs", files={"log": ("other.csv", content)}).json()["logs"]
    assert [entry["id"] for entry in again] == [log["id"]]


def test_a_file_that_is_no_log_is_refused_with_the_reason_and_not_kept(client):
    """The reader says why."""
    log = dropped(client, "notes.BIN", b"\x00\x01 nothing")
    assert log["state"] == "refused" and log["error"]
    assert not list((client.folder / "logs" / log["id"]).rglob("upload"))
    answer = client.post("/diagnoses", json={"log": log["id"], "vehicle": "paper"})
    assert answer.status_code == 422 and "cannot be read" in answer.json()["detail"]


def test_a_diagnosis_goes_from_the_queue_to_a_verdict_with_files(client):
    """Its events tell how far it is and end with the verdict; healthy dives of the vehicle are taken along."""
    healthy = dropped(client, "sound.csv")
    assert client.patch(f"/logs/{healthy['id']}", json={"healthy": True}).json()["healthy"]
    job = client.post("/diagnoses", json={"log": dropped(client)["id"]}).json()
    assert job["healthy"] == [healthy["id"]]
    events = [line for line in client.get(f"/diagnoses/{job['id']}/events").text.splitlines() if line]
    assert events[-2] == "event: end" and json.loads(events[-1][6:])["verdict"] == "explained"
    done = over(client, job)
    assert (done["state"], done["summary"], done["share"]) == ("done", "Thruster 4 is weak.", 1.0)
    client.patch(f"/logs/{healthy['id']}", json={"healthy": False})
    assert {"report.html", "advice.param", "diagnosis.json"} <= set(done["files"])
    advice = client.get(f"/diagnoses/{job['id']}/files/advice.param")
    assert advice.text == "MOT_1_DIRECTION,1\n" and "attachment" in advice.headers["content-disposition"]


def test_a_history_and_a_calibration_of_a_vehicle_are_jobs_too(client):
    """The calibrated file is a vehicle that the next dive can be diagnosed with."""
    sound, later = dropped(client, "2026-01-01.csv"), dropped(client, "2026-02-01.csv")
    for log in (sound, later):
        client.patch(f"/logs/{log['id']}", json={"vehicle": "bluerov2"})
    wanted = {"kind": "history", "logs": [later["id"]], "vehicle": "bluerov2"}
    assert client.post("/diagnoses", json=wanted).status_code == 422  # nothing is marked healthy
    client.patch(f"/logs/{sound['id']}", json={"healthy": True})
    history = over(client, client.post("/diagnoses", json=wanted).json())
    assert history["state"] == "done" and "dives.html" in history["files"]
    job = client.post("/diagnoses", json={"kind": "calibration", "vehicle": "bluerov2"}).json()
    assert over(client, job)["state"] == "done"
    names = [vehicle["name"] for vehicle in client.get("/vehicles").json()["vehicles"]]
    assert f"calibrated_{job['id']}" in names
    again = client.post("/diagnoses", json={"log": later["id"], "vehicle": f"calibrated_{job['id']}"}).json()
    answer = client.get(f"/diagnoses/{over(client, again)['id']}/files/diagnosis.json").json()
    assert f"vehicle=jobs/{job['id']}/bluerov2_calibrated.yaml" in answer["arguments"]
    dives = client.get("/vehicles/bluerov2").json()["dives"]
    assert [dive["name"] for dive in dives] == ["2026-01-01.csv", "2026-02-01.csv"]


@pytest.mark.parametrize(("name", "error"), [("wrong.csv", "this log is of no use"), ("crash.csv", "signal 9")])
def test_a_diagnosis_that_fails_says_why_and_leaves_the_server_at_work(client, name, error):
    """Also one whose process is ended by the system."""
    failed = over(client, client.post("/diagnoses", json={"log": dropped(client, name)["id"]}).json())
    assert failed["state"] == "failed" and error in failed["error"]
    fine = dropped(client, "fine.csv")
    assert over(client, client.post("/diagnoses", json={"log": fine["id"]}).json())["state"] == "done"


def test_a_running_and_a_waiting_diagnosis_are_cancelled(client):
    """One runs at a time; what is over cannot be cancelled, and a dive in use cannot be deleted."""
    log = dropped(client, "slow.csv")
    first, second = (client.post("/diagnoses", json={"log": log["id"]}).json() for _ in range(2))
    until(lambda: client.get(f"/diagnoses/{first['id']}").json()["share"] == 0.4, "progress")
    assert client.get(f"/diagnoses/{second['id']}").json()["state"] == "waiting"
    assert client.delete(f"/logs/{log['id']}").status_code == 409
    for job in (second, first):
        assert client.delete(f"/diagnoses/{job['id']}").json()["state"] == "cancelled"
    assert client.delete(f"/diagnoses/{first['id']}").status_code == 409
    assert client.delete(f"/logs/{log['id']}").status_code == 204
    assert client.get(f"/diagnoses/{first['id']}").status_code == 404


def test_a_server_that_ended_goes_on_with_its_queue(tmp_path, standin):
    """What was running when it was killed runs again, what was there is there, and two at once are refused."""
    needs_extra()
    from auv_torchrl.page.app import FolderInUse, make_app

    with serving(tmp_path / "page") as client:
        with pytest.raises(FolderInUse):
            make_app(tmp_path / "page")
        job = client.post("/diagnoses", json={"log": dropped(client)["id"]}).json()
        over(client, job)
    store = Store(tmp_path / "page")
    store.change_job(job["id"], state=JobState.RUNNING, ended="", verdict="")
    store.close()
    with serving(tmp_path / "page") as client:
        assert over(client, job)["verdict"] == "explained"


def test_a_job_ends_with_its_server_however_that_went(tmp_path):
    """The pipe that the server holds ends, and so does the process."""
    command = [sys.executable, "-m", "auv_torchrl.page.child", "0", "tests.page.standin", "log=slow", "output=x"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
        env={"PYTHONPATH": str(PROJECT), "PATH": ""},
    ) as child:  # fmt: skip
        assert child.stdin is not None and child.stdout is not None
        assert b"20 %" in child.stdout.readline()
        begun = time.monotonic()
        child.stdin.close()
        assert child.wait(30) != 0 and time.monotonic() - begun < 30


def test_what_changes_while_news_are_on_their_way_is_told_next():
    """A page that has just heard something misses nothing, and is told whether it is more than progress."""
    needs_extra()
    from auv_torchrl.page.worker import Board

    async def heard():
        board = Board()
        news = board.changes(60.0)
        said = [await anext(news)]
        for is_progress in (False, True):
            board.tell(is_progress)
            said.append(await asyncio.wait_for(anext(news), 10.0))
        return said

    with ThreadPoolExecutor(1) as pool:  # a browser that was opened before leaves a loop in this thread
        said = pool.submit(asyncio.run, heard()).result()
    assert said == ["hello", "changed", "progress"]


def test_the_interface_describes_itself(client):
    """openapi.json names every operation; the page about it loads nothing from elsewhere."""
    paths = client.get("/openapi.json").json()["paths"]
    assert {"/logs", "/logs/{id}", "/diagnoses", "/diagnoses/{id}", "/diagnoses/{id}/events", "/vehicles"} <= set(paths)
    assert set(paths["/diagnoses/{id}"]) == {"get", "delete"}
    assert "Cancel a diagnosis" in client.get("/api").text and client.get("/docs").status_code == 404
