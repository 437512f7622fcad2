"""Compressed files: around a log of any format, damaged, more than one file, and megabytes that become gigabytes."""

import bz2
import gzip
import io
import lzma
import warnings
import zipfile
from functools import cache

from hypothesis import strategies as st

from tests.flightlog.fuzz import dataflash, mcap, tables, ulog
from tests.flightlog.fuzz.damage import Draw, Log, bytes_altered, chance
from tests.flightlog.fuzz.values import sizes, stems, texts

_BOMB_BYTES = 2 << 30  # 2.1 MB in gzip
_SUFFIX = {"gz": ".gz", "xz": ".xz", "bz2": ".bz2", "zip": ".zip"}


def _pack(kind: str, data: bytes, inner: str) -> bytes:
    match kind:
        case "gz":
            return gzip.compress(data, 1)
        case "xz":
            return lzma.compress(data, preset=0)
        case "bz2":
            return bz2.compress(data, 1)
    return _zipped([(inner, data)])


def _zipped(members: list[tuple[str, bytes]]) -> bytes:
    made = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")  # two members of one name are what is wanted
        for name, data in members:
            archive.writestr(name.encode("utf-8", "replace").decode().replace("\0", "0")[:200] or "x", data)
    return made.getvalue()


@cache
def _bomb(kind: str) -> bytes:
    block, count = bytes(1 << 24), _BOMB_BYTES >> 24
    head = b"t,x,y,z,yaw,cmd_1\n"
    if kind == "zip":
        made = io.BytesIO()
        with (
            zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            archive.open("log.csv", "w", force_zip64=True) as member,
        ):
            member.write(head)
            for _ in range(count):
                member.write(block)
        return made.getvalue()
    made = io.BytesIO()
    with gzip.GzipFile(fileobj=made, mode="wb", compresslevel=1) as file:
        file.write(head)
        for _ in range(count):
            file.write(block)
    return made.getvalue()


@st.composite
def _log(draw: Draw) -> Log:
    return draw(st.one_of(dataflash.logs(), ulog.logs(), mcap.logs(), tables.csv_logs(), tables.parquet_logs()))


@st.composite
def _packed(draw: Draw) -> Log:
    kind = draw(st.sampled_from(list(_SUFFIX)))
    if chance(draw, 30):
        return Log(draw(stems) + _SUFFIX[kind], _bomb("zip" if kind == "zip" else "gz"))
    inner = draw(_log())
    assert isinstance(inner.content, bytes)
    data = _pack(kind, inner.content, inner.name)
    if kind == "zip" and chance(draw, 2):
        members = [(inner.name, inner.content), (draw(texts), b"text"), ("folder/", b"")]
        more = draw(st.integers(0, 3))
        data = _zipped(
            members[:more] if chance(draw, 3) else [*members[: 1 + more], (inner.name, inner.content)][:more]
        )
    if chance(draw, 8):
        other = draw(st.sampled_from(list(_SUFFIX)))
        data, inner = (
            _pack(other, data, f"{inner.name}{_SUFFIX[kind]}"),
            inner._replace(name=inner.name + _SUFFIX[kind]),
        )
        kind = other
    if chance(draw, 8):  # a size of the zip's directory, or of the end of gzip, that is claimed
        size = (draw(sizes) % 2**32).to_bytes(4, "little")
        at = len(data) - draw(st.integers(4, min(len(data), 80)))
        data = data[:at] + size + data[at + 4 :]
    name = inner.name + _SUFFIX[kind]
    return Log(name if not chance(draw, 8) else draw(stems) + draw(st.sampled_from(("", ".csv", ".BIN", ".zip"))), data)


@st.composite
def _damaged(draw: Draw) -> Log:
    log = draw(_packed())
    assert isinstance(log.content, bytes)
    return log if len(log.content) > 1_000_000 else log._replace(content=bytes_altered(draw, log.content))


def logs() -> st.SearchStrategy[Log]:
    """Compressed files."""
    return _damaged()
