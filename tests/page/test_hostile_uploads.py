"""Requests that mean harm: names, sizes, contents, other sites, other names of this machine."""

import gzip
import io
import random
import re
import time
import zipfile

import pytest

from auv_torchrl.paths import EXAMPLE_LOG
from tests.page.conftest import another, dropped, needs_extra, over, serving, until

AT_ONCE = 50
PARTS = (
    "..", "/", "\\", "\0", "\n", "\r\n", '"', "'", ";", "$(id)", "`id`", "%2e%2e%2f", "C:", "con", "nul", ".BIN",
    ".csv", ".gz", ".zip", ".parquet", ".py", ".html", "<script>", "{{7*7}}", "${x}", "=[", ",", " ", "\u202e",
    "\ud83d", "é", "a" * 300, "-rf", "--", "~", "dive", "about.json", "overview.npz", "log", "*", "?", "|", "\x1b[2J",
)  # fmt: skip


def drawn_name(rng):
    """A name of up to six such parts."""
    return "".join(rng.choice(PARTS) for _ in range(rng.randint(0, 6))).encode("utf-8", "replace").decode()


def drawn_content(rng):
    """Nothing, noise, a piece of a log, a log of other numbers, something packed."""
    example = EXAMPLE_LOG.read_bytes()
    kind = rng.randint(0, 6)
    if kind == 0:
        return b""
    if kind == 1:
        return rng.randbytes(rng.randint(1, 400))
    if kind == 2:
        return example[: rng.randint(1, 3000)]
    if kind == 3:
        return b"\xa3\x95\x80" + rng.randbytes(rng.randint(0, 600))
    if kind == 4:
        rows = [",".join(str(rng.choice([0, 1e308, -1e308, "nan", "inf", "", "x", rng.random()])) for _ in range(4))]
        return ("t,z,yaw,cmd_1\n" + "\n".join(rows * rng.randint(1, 30))).encode()
    if kind == 5:
        return gzip.compress(rng.randbytes(rng.randint(0, 200)) * rng.randint(1, 50))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr(f"x{drawn_name(rng)}", rng.randbytes(50))
    return packed.getvalue()


def form_of(rng, files):
    """A form as a browser or somebody else writes it: names with whatever is in them."""
    boundary = "x" * 20
    body = b""
    for name, content in files:
        escaped = name.encode("utf-8", "replace")
        if rng.random() < 0.8:
            escaped = escaped.replace(b'"', b"%22").replace(b"\r", b"%0D").replace(b"\n", b"%0A")
        head = b'--%b\r\nContent-Disposition: form-data; name="log"; filename="%b"\r\n\r\n' % (
            boundary.encode(),
            escaped,
        )
        body += head + content + b"\r\n"
    end = b"--%b--\r\n" % boundary.encode()
    return body + (end if rng.random() < 0.95 else b""), f"multipart/form-data; boundary={boundary}"


@pytest.mark.parametrize("drawn", [200, pytest.param(2000, marks=[pytest.mark.slow, pytest.mark.thorough])])
def test_hostile_uploads_crash_nothing_and_stay_in_their_folders(tmp_path, drawn):
    """Every answer is one of a server at work, every file lies in a folder of its own, under a harmless name."""
    rng = random.Random(20261126)
    outside = tmp_path / "outside"
    outside.mkdir()
    place = tmp_path / "page"
    with serving(place) as client:
        for number in range(drawn // AT_ONCE):
            files = [(drawn_name(rng), drawn_content(rng)) for _ in range(AT_ONCE)]
            if number % 2:
                body, kind = form_of(rng, files)
                statuses = [client.post("/logs", content=body, headers={"content-type": kind}).status_code]
            else:
                statuses = [client.post("/logs", params={"name": n}, content=c).status_code for n, c in files]
            assert set(statuses) <= {201, 400, 413, 507}

        def read():
            time.sleep(0.5)
            now = client.get("/logs").json()["logs"]
            return now if all(log["state"] != "waiting" for log in now) else []

        logs = until(read, "the reading of all logs")
        assert len(logs) > drawn / 10
        assert client.get("/").status_code == 200
        kept = {log["id"] for log in logs if log["state"] == "ready"}
        assert all(log["error"] for log in logs if log["state"] == "refused")
    assert not list(outside.iterdir()) and {path.name for path in tmp_path.iterdir()} == {"outside", "page"}
    known = {"logs", "jobs", "incoming", "temporary", "page.sqlite", "page.sqlite-wal", "page.sqlite-shm", ".lock"}
    assert {path.name for path in place.iterdir()} <= known
    assert not list((place / "incoming").iterdir())
    for path in (place / "logs").rglob("*"):
        parts = path.relative_to(place / "logs").parts
        assert not path.is_symlink() and re.fullmatch(r"[0-9a-f]{16}", parts[0])
        assert parts[1:] in ((), ("upload",), ("about.json",), ("overview.npz",)) or (
            parts[1] == "upload" and len(parts) == 3 and re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]*", parts[2])
        )
        assert len(parts) < 3 or parts[0] in kept
        assert not path.is_file() or not path.stat().st_mode & 0o111


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../../x", "a/b\\c.BIN", "-rf", ".bashrc", "con.csv", "NUL", "x" * 999]
)
def test_a_name_on_disk_is_harmless(name):
    """One part, no option, no hidden file, no device, not too long."""
    needs_extra()
    from auv_torchrl.page.upload import stored_name

    kept = stored_name(name)
    assert re.fullmatch(r"[A-Za-z0-9_][A-Za-z0-9._-]*", kept) and len(kept) <= 84
    assert kept.split(".")[0].lower() not in ("con", "nul")


def test_a_log_that_is_too_large_is_refused_while_it_comes(tmp_path):
    """Whatever length it says; nothing of it is kept."""
    with serving(tmp_path / "page", most_bytes=1000) as client:
        assert client.post("/logs", params={"name": "a.csv"}, content=b"x" * 1001).status_code == 413
        assert client.post("/logs", files={"log": ("a.csv", b"x" * 1001)}).status_code == 413
        huge = {"content-length": str(1 << 60), "content-type": "application/octet-stream"}
        assert client.post("/logs", params={"name": "a.csv"}, content=b"x", headers=huge).status_code == 507
        assert client.post("/diagnoses", content=b'{"log": "' + b"x" * (1 << 19) + b'"}').status_code == 413
        piecewise = (b"x" * 1000 for _ in range(300))  # without saying how much it will be
        assert client.post("/ui/diagnosis", content=piecewise).status_code == 413
        assert not list((tmp_path / "page" / "incoming").iterdir())


@pytest.mark.parametrize(
    "path",
    [
        "../../../page.sqlite",
        "..%2f..%2fpage.sqlite",
        "%2e%2e/output.txt",
        "/etc/passwd",
        "result/report.html",
        "x.txt",
        "",
    ],
)
def test_only_what_a_diagnosis_wrote_is_handed_out(client, path):
    """No other file of the folder, however it is spelt."""
    job = over(client, client.post("/diagnoses", json={"log": dropped(client)["id"]}).json())
    answer = client.get(f"/diagnoses/{job['id']}/files/{path}")
    assert answer.status_code in (404, 307) and b"SQLite" not in answer.content


def test_an_upload_is_never_handed_out(client):
    """There is no address under which a browser would get what somebody dropped."""
    log = dropped(client, "page.html.csv")
    for path in (f"/logs/{log['id']}/upload/page.html.csv", f"/logs/{log['id']}/file", "/static/page.html.csv"):
        assert client.get(path).status_code == 404


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8766", "127.0.0.1.evil.example", "192.168.1.7", "", "[::"]
)
def test_a_name_that_is_not_ours_is_not_answered(client, host):
    """A site that lets its name point here gets nothing, not even to read."""
    assert client.get("/logs", headers={"host": host}).status_code == 421


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"}, {"origin": "null"}, {"origin": "http://127.0.0.1:9999"},
        {"origin": "http://127.0.0.1:8766"}, {"sec-fetch-site": "cross-site"}, {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "same-origin"},
        {"origin": "http://127.0.0.1:8766", "cookie": "auv_page=guess"},
    ],
)  # fmt: skip
def test_a_page_of_another_site_changes_nothing(client, headers):
    """Neither from elsewhere, nor from here without the cookie that browsers give to no other site's requests."""
    client.cookies.clear()
    before = client.get("/logs", headers={"cookie": "none"}).json()["logs"]
    client.cookies.clear()
    for method, path in (
        ("POST", "/logs?name=a.csv"),
        ("POST", "/diagnoses"),
        ("DELETE", "/logs/x"),
        ("POST", "/ui/diagnosis"),
    ):
        assert client.request(method, path, headers=headers, content=b"{}").status_code == 403
    assert client.get("/logs").json()["logs"] == before


def test_a_page_of_ours_changes_what_it_asks_for(client):
    """The cookie is for this site alone, and no script reads it."""
    client.cookies.clear()
    set_cookie = client.get("/").headers["set-cookie"]
    assert "SameSite=Strict" in set_cookie and "HttpOnly" in set_cookie
    ours = {"origin": "http://127.0.0.1:8766", "sec-fetch-site": "same-origin"}
    assert client.post("/logs?name=a.csv", content=another(), headers=ours).status_code == 201


def test_pages_and_reports_may_run_nothing_foreign(client):
    """Pages run scripts of this server alone; a report runs none, and only its own style counts."""
    pages = client.get("/").headers["content-security-policy"]
    assert "default-src 'none'" in pages and "script-src 'self'" in pages and "unsafe" not in pages
    job = over(client, client.post("/diagnoses", json={"log": dropped(client)["id"]}).json())
    report = client.get(f"/diagnoses/{job['id']}/files/report.html").headers["content-security-policy"]
    assert "default-src 'none'" in report and "script-src" not in report and "unsafe" not in report
    assert "sandbox allow-same-origin" in report and "style-src 'sha256-" in report
    for address in ("/", "/vehicle/", "/api", f"/diagnosis/{job['id']}", f"/dive/{job['logs'][0]}"):
        text = client.get(address).text
        assert not re.search(r"\son\w+=|\sstyle=|javascript:|<script>|https?://(?!127\.0\.0\.1)", text), address


def test_what_a_log_says_is_text_on_every_page(client):
    """A name that is a piece of a page stays a name."""
    log = dropped(client, '"><script>alert(1)</script>.csv')
    for address in ("/", f"/dive/{log['id']}", "/vehicle/paper"):
        text = client.get(address).text
        assert "<script>alert" not in text and "&lt;script&gt;alert(1)" in text


def test_other_machines_are_served_only_where_somebody_said_so(capsys):
    """And what that means is said."""
    from auv_torchrl.page.command import main

    with pytest.raises(SystemExit) as ended:
        main(["--host", "0.0.0.0"])
    assert ended.value.code == 2 and "without a password" in capsys.readouterr().err
