"""Logs that are packed by gzip, xz, bzip2, zstd, lz4 or zip are read as they are, and bombs are refused."""

import bz2
import gzip
import io
import lzma
import tempfile
import zipfile

import pytest

from auv_torchrl.diagnosis.command.logs import _inside
from auv_torchrl.flightlog import FlightLogError, read_flightlog
from auv_torchrl.flightlog.command import main
from auv_torchrl.flightlog.readers import packed_log, read_log
from auv_torchrl.flightlog.streams.stream import Streams
from auv_torchrl.flightlog.tables.table import Table
from auv_torchrl.paths import EXAMPLE_LOG
from auv_torchrl.vehicle import load_vehicle
from tests.flightlog.shared_data import EXCERPTS

CSV = b"t,x,y,yaw,cmd_1\n" + b"".join(b"%d.0,0.1,0.2,0.3,0.4\n" % k for k in range(50))


@pytest.fixture(autouse=True)
def room(tmp_path, monkeypatch):
    """A folder of its own for what is unpacked; nothing is left there."""
    folder = tmp_path / "room"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    yield folder
    assert not list(folder.iterdir())


def zipped(members: dict[str, bytes]) -> bytes:
    """A zip file with these members."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def packed(kind: str, content: bytes) -> bytes:
    if kind == "zst":
        return pytest.importorskip("zstandard").compress(content)
    if kind == "lz4":
        return pytest.importorskip("lz4.frame").compress(content)
    if kind == "zip":
        return zipped({"__MACOSX/._log": b"\0", "folder/log": content})
    return {"gz": gzip, "xz": lzma, "bz2": bz2}[kind].compress(content)


def refusal(path) -> str:
    with pytest.raises(FlightLogError) as error:
        read_log(path)
    assert path.name in str(error.value) and "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("kind", ["gz", "xz", "bz2", "zst", "lz4", "zip"])
def test_a_packed_log_is_read_under_its_own_name(tmp_path, kind):
    """Tables and logs of vehicles alike, whatever packed them."""
    for name, content in {"dive.csv": CSV, "dive.tlog": (EXCERPTS / "ardusub.tlog").read_bytes()}.items():
        path = tmp_path / f"{name}.{kind}"
        path.write_bytes(packed(kind, content))
        read = read_log(path)
        assert read.name == path.name and not [f for f in read.findings if f.code == "damaged_packing"]
        assert len(read.row) == 50 if isinstance(read, Table) else len(read.streams["attitude"]) == 280


def test_every_command_opens_a_packed_log(tmp_path, capsys):
    """auv-log info and convert, the reader of the diagnosis, and a folder of dives."""
    path = tmp_path / "flight.csv.gz"
    path.write_bytes(gzip.compress(EXAMPLE_LOG.read_bytes()))
    main(["info", str(path)])
    main(["convert", str(path), f"output={tmp_path / 'again.csv'}"])
    assert "flight.csv.gz: table" in capsys.readouterr().out
    log, plain = (read_flightlog(p, load_vehicle("paper")) for p in (path, EXAMPLE_LOG))
    assert log.name == "flight.csv.gz" and log.samples == plain.samples
    assert [p.name for p in _inside(tmp_path)] == ["again.csv", "flight.csv.gz"]


def test_a_packing_within_a_packing_is_opened_up_to_a_depth(tmp_path):
    """A zip of a gz is; four times over is named."""
    path = tmp_path / "dive.csv.gz.zip"
    path.write_bytes(zipped({"dive.csv.gz": gzip.compress(CSV)}))
    assert read_log(path).name == path.name
    content = CSV
    for _ in range(4):
        content = gzip.compress(content)
    path.write_bytes(content)
    assert "is packed more than 3 times over" in refusal(path)


def test_a_packing_that_was_cut_is_read_as_far_as_it_goes(tmp_path):
    """A finding says how far, or a sentence that nothing came."""
    path = tmp_path / "ardusub.tlog.gz"
    whole = gzip.compress((EXCERPTS / "ardusub.tlog").read_bytes())
    path.write_bytes(whole[: len(whole) // 2])
    read = read_log(path)
    assert isinstance(read, Streams) and 0 < len(read.streams["attitude"]) < 280
    assert read.findings[0].code == "damaged_packing" and "gzip unpacked" in read.findings[0].sentence
    path.write_bytes(whole[:12])
    assert "cannot be unpacked as gzip" in refusal(path)


@pytest.mark.parametrize("kind", ["gz", "xz", "bz2", "zst", "lz4", "zip"])
def test_what_becomes_too_large_is_refused(tmp_path, monkeypatch, kind):
    """Before it fills the disk, whatever it claims."""
    monkeypatch.setattr(packed_log, "MOST_BYTES", 1 << 20)
    path = tmp_path / f"zeros.csv.{kind}"
    path.write_bytes(packed(kind, bytes(5 << 20)))
    assert "unpacks to more than 1 MiB" in refusal(path)


def test_of_a_zip_file_the_one_log_is_read(tmp_path):
    """Beside what is no log; members of that kind are named where there are several, or none."""
    path = tmp_path / "dive.zip"
    path.write_bytes(zipped({"notes.txt": b"a fine dive", "dive.csv": CSV, "picture.png": b"\x89PNG"}))
    assert read_log(path).name == "dive.zip"
    path.write_bytes(zipped({"a.csv": CSV, "b\x1b[31m.csv": CSV}))
    assert r"holds 2 logs (a.csv, b\x1b[31m.csv): unpack it and give one log" in refusal(path)
    path.write_bytes(zipped({"notes.txt": b"a", "more.txt": b"b"}))
    assert "holds no log (notes.txt, more.txt)" in refusal(path)
    path.write_bytes(zipped({"[Content_Types].xml": b"<a/>", "xl/workbook.xml": b"<a/>"}))
    assert "is an Excel or Word file: export the log" in refusal(path)


def test_members_of_a_zip_file_lead_nowhere_else(tmp_path):
    """A name with .. or from the root is read, and nothing is written where it points."""
    for name in ("../../evil.csv", "/evil.csv", "a\\..\\evil.csv"):
        path = tmp_path / "dive.zip"
        path.write_bytes(zipped({name: CSV}))
        assert len(read_log(path).findings) == 0
        assert not list(tmp_path.rglob("*evil*"))


def test_a_zip_file_that_cannot_be_opened_says_why(tmp_path, monkeypatch):
    """A password, a packing that is not known, thousands of files, other archives."""
    path = tmp_path / "dive.zip"
    whole = bytearray(zipped({"dive.csv": CSV}))
    for at in (6, whole.index(b"PK\x01\x02") + 8):
        whole[at] |= 1
    path.write_bytes(whole)
    assert "needs a password" in refusal(path)
    whole = bytearray(zipped({"dive.csv": CSV}))
    for at in (8, whole.index(b"PK\x01\x02") + 10):
        whole[at] = 99
    path.write_bytes(whole)
    assert "cannot be opened (NotImplementedError" in refusal(path)
    monkeypatch.setattr(packed_log, "_MOST_MEMBERS", 10)
    path.write_bytes(zipped({f"{k}.csv": CSV for k in range(11)}))
    assert "holds 11 files" in refusal(path)
    for begin, how in ((b"7z\xbc\xaf\x27\x1c", "7-Zip"), (b"Rar!\x1a", "RAR"), (b"PK\x05\x06", "nothing in it")):
        path.write_bytes(begin + bytes(40))
        assert how in refusal(path)
