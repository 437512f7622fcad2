"""Tables: CSV with any cells, names, remarks and line ends, and Parquet with columns of every type."""

import io
import json
from functools import cache

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from hypothesis import strategies as st

from auv_torchrl.flightlog.tables.columns import KNOWN
from tests.flightlog.fuzz.damage import MOST, Draw, Log, bytes_altered, chance, named, place, reordered
from tests.flightlog.fuzz.values import json_texts, numbers, raw, texts

_NAMES = (
    *KNOWN, "time", "timestamp", "depth", "heading", "yaw_deg", "qw", "qx", "qy", "qz", "pwm1", "servo1_raw", "pwm_9",
    "T", "measured", "cmd_99", "", "x ", '"x"', "Yaw", "x\x1b[31m",
)  # fmt: skip
_CELLS = (
    "0", "1", "-1", "0.05", "1e308", "-1e308", "1e-320", "nan", "inf", "", "x", '"', "0x10", "é", "1_0", "1500", "1,5",
    "2023-11-14T22:13:20Z", "1700000000000", "22:13:20", "true", "１", "9" * 400, "\x1b[31m", "\u202e",
)  # fmt: skip
_ROWS = 60
_SAID = {"snapshot_s": 0.0, "drift": {"x": 0.0}, "autopilot": {"MOT_1_DIRECTION": 1.0}}


@cache
def _sound() -> dict[str, np.ndarray]:
    """Three seconds of a vehicle with eight thrusters."""
    t = np.arange(_ROWS) * 0.05
    turn = {
        "x": 0.1 * t,
        "y": 0.2 * t,
        "z": 1 + 0.1 * np.sin(t),
        "yaw": 0.3 * t,
        "u": 0.2 + 0 * t,
        "v": 0 * t,
        "r": 0.3 + 0 * t,
    }
    return {"t": t, **turn, **{f"cmd_{i}": 0.5 * np.sin(i * t) for i in range(1, 9)}}


@st.composite
def _csv(draw: Draw) -> bytes:
    names = list(_sound())
    rows = [[f"{value:.5g}" for value in row] for row in zip(*_sound().values(), strict=True)]
    for _ in range(draw(st.integers(1, 2)) if chance(draw, 2) else 0):
        i = place(draw, len(names))
        names[i] = draw(st.sampled_from(_NAMES) | texts)
        if chance(draw, 2):
            cell = draw(st.sampled_from(_CELLS) | texts)
            rows = [[*row[:i], cell, *row[i + 1 :]] for row in rows]
    for _ in range(draw(st.integers(1, 2 * MOST)) if not chance(draw, 3) else 0):
        rows[place(draw, len(rows))][place(draw, len(names))] = draw(st.sampled_from(_CELLS) | texts)
    lines = [",".join(row).encode("utf-8", "surrogatepass") for row in [names, *reordered(draw, rows)]]
    match draw(st.sampled_from(("plain", "plain", "plain", "said", "remark", "raw"))):
        case "said":
            said = {key: json.dumps(value) for key, value in _SAID.items()}
            said[draw(st.sampled_from(list(said)))] = draw(json_texts)
            spelt = ", ".join(f'"{key}": {value}' for key, value in said.items())
            lines.insert(0, f"# auv-log: {{{spelt}}}".encode("utf-8", "surrogatepass"))
        case "remark":
            lines.insert(0, b"# " + draw(raw))
        case "raw":
            lines.insert(place(draw, len(lines)), draw(raw))
    end = draw(st.sampled_from((b"\n", b"\n", b"\n", b"\r\n", b"\r")))
    begin = draw(st.sampled_from((b"", b"", b"", b"\xef\xbb\xbf", b"sep=,\n", b"\n")))
    return bytes_altered(draw, begin + end.join(reordered(draw, lines)) + end)


_STAMPS = [1_700_000_000_000 + 50 * k for k in range(_ROWS)]


def _columns(draw: Draw, values: np.ndarray) -> pa.Array:
    """The values as another type, or other values."""
    whole = [int(v * 100) for v in values]
    some: list[float | None] = [None if k % 7 == 0 else float(v) for k, v in enumerate(values)]
    kinds = {
        "float": lambda: pa.array(values, pa.float32()),
        "half": lambda: pa.array(values.astype(np.float16)),
        "int": lambda: pa.array(whole, pa.int16()),
        "bool": lambda: pa.array([v > 0 for v in values]),
        "text": lambda: pa.array([str(v) for v in values]),
        "bytes": lambda: pa.array([b"\xff\x1b"] * len(values), pa.binary()),
        "some": lambda: pa.array(some),
        "null": lambda: pa.nulls(len(values)),
        "time": lambda: pa.array(_STAMPS[: len(values)], pa.timestamp("ms")),
        "ns": lambda: pa.array([s * 10**6 for s in _STAMPS[: len(values)]], pa.timestamp("ns", tz="Europe/Oslo")),
        "span": lambda: pa.array(whole, pa.duration("us")),
        "day": lambda: pa.array([abs(v) for v in whole], pa.date32()),
        "list": lambda: pa.array([[float(v)] for v in values]),
        "struct": lambda: pa.array([{"x": float(v)} for v in values]),
        "decimal": lambda: pa.array(whole, pa.decimal128(20, 4)),
        "dictionary": lambda: pa.array([str(v) for v in values]).dictionary_encode(),
        "any": lambda: pa.array(draw(st.lists(numbers.map(_as_float), min_size=len(values), max_size=len(values)))),
        "tricks": lambda: pa.array(draw(st.lists(_plain, min_size=len(values), max_size=len(values)))),
    }
    return kinds[draw(st.sampled_from(list(kinds)))]()


_plain = texts.map(lambda text: text.encode("utf-8", "replace").decode())


def _as_float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return float("inf")


@st.composite
def _parquet(draw: Draw) -> bytes:
    columns: dict[str, pa.Array] = {name: pa.array(values) for name, values in _sound().items()}
    for _ in range(draw(st.integers(1, 2)) if not chance(draw, 3) else 0):
        name = draw(st.sampled_from(list(_sound())))
        new = draw(st.sampled_from(_NAMES) | _plain) if chance(draw, 2) else name
        columns[new] = _columns(draw, _sound()[name])
    table = pa.table(columns)
    if chance(draw, 3):
        said = json.dumps(_SAID) if chance(draw, 2) else draw(json_texts)
        table = table.replace_schema_metadata({b"auv-log": said.encode("utf-8", "surrogatepass"), b"x": draw(raw)})
    sink = io.BytesIO()
    packing = draw(st.sampled_from(("snappy", "zstd", "gzip", "none", "lz4")))
    pyarrow.parquet.write_table(table, sink, compression=packing, row_group_size=draw(st.sampled_from((1000, 7))))
    data = sink.getvalue()
    end = data[-2000:] if chance(draw, 2) else b""  # what says how all else is to be read
    return data[: len(data) - len(end)] + bytes_altered(draw, end) if end else bytes_altered(draw, data)


def csv_logs() -> st.SearchStrategy[Log]:
    """Tables as text."""
    return named((".csv", ".csv", ".txt", ""), _csv())


def parquet_logs() -> st.SearchStrategy[Log]:
    """Tables as Parquet."""
    return named((".parquet", ".pq", ""), _parquet())
