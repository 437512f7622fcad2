"""What a field may hold that no program of a vehicle writes: the wrong type, no number, too much of it, or a trick."""

import json

from hypothesis import strategies as st

TRICKS = (
    "", " ", "\n", "a\nb", "\r\n", "\x1b[31mred\x1b[0m", "\x1b]0;title\x07", "\x9b2J", "\x00", "a\x00b",
    "\u202egnp.exe", "\u2028", "\u200b", "\ufeff", "\x7f", "<script>", "{{x}}", "${oc.env:HOME}", "=1+1", "%s%n",
    "../../x", "x" * 3000, "é", "\U0001f41f", "１２", "nan", "-inf", "1e999", "9" * 400, "-" + "9" * 400,
    "0." + "1" * 400, "1_0", "0x10", "1,5", "None", "true", "[", "[" * 1000, '{"a":' * 1000,
)  # fmt: skip
texts = st.one_of(st.sampled_from(TRICKS), st.text(max_size=12))
raw = st.one_of(  # of a text in a file, which need not be UTF-8
    texts.map(lambda text: text.encode("utf-8", "surrogatepass")),
    st.sampled_from([b"\xff", b"\xc3", b"\xed\xa0\x80", b"\x00" * 8, b"\xff" * 8, b"\xfe\xff"]),
    st.binary(max_size=12),
)
integers = st.one_of(
    st.sampled_from([0, 1, -1, 7, 127, 128, 255, 256, 2**15, 2**16 - 1, 2**31 - 1, -(2**31), 2**32 - 1, 2**63 - 1]),
    st.sampled_from([-(2**63), 2**64 - 1, 2**64, -(2**64), 10**400]),
    st.integers(-1000, 3000),
)
floats = st.one_of(
    st.sampled_from([float("nan"), float("inf"), -float("inf"), 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-40, 3.5e38, 1e18]),
    st.floats(width=32),
    st.floats(-2.0, 2.0),
)
numbers = st.one_of(integers, floats)
sizes = st.one_of(  # that are claimed and need not be there
    st.sampled_from([0, 1, 2**7, 2**15, 2**16 - 1, 2**20, 2**28, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1]),
    st.integers(0, 300),
)

_WORDS = (
    "NaN",
    "Infinity",
    "-Infinity",
    "null",
    "true",
    "9" * 400,
    "-1e999",
    "1" + "0" * 5000,
    '"\\ud800"',
    '"\\u0000"',
)
_NESTED = tuple(begin * depth + end * depth for begin, end in ("[]", ('{"a":', "}")) for depth in (3, 1000, 100_000))
_SHAPES = (
    "[]",
    "{}",
    '[""]',
    "[null]",
    '[["a"]]',
    '{"bits": []}',
    '{"type": {}}',
    '{"bits": {"bits": 1}}',
    '{"type": [1]}',
)
json_texts = st.one_of(  # as text, since no object can hold what a text can claim
    st.sampled_from(_WORDS + _NESTED + _SHAPES),
    texts.map(lambda text: json.dumps(text)),
    numbers.map(lambda number: json.dumps(number)[:4000] if abs(number) < 1e300 else "1e400"),
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=4),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=5,
    ).map(json.dumps),
)

stems = st.one_of(  # of the names of files; most are plain, since what is in the file matters more
    st.just("flight"), st.just("flight"), st.just("flight"), st.just("flight"),
    st.sampled_from(["fl\x1b[31might", "a\nb", "\u202egnp", "x" * 180, "é", "\udcff\udcfe", "a b", "-x", "k=v", "%s"]),
)  # fmt: skip
