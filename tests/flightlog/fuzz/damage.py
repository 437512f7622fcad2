"""What happens to the bytes of a log: flipped, cut, written over, and records lost, repeated, moved and mixed."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

from hypothesis import strategies as st

from tests.flightlog.fuzz.values import stems

Draw = Callable[[st.SearchStrategy[Any]], Any]
T = TypeVar("T")
MOST = 4  # alterations of one log; more of them only make logs that are refused at once


class Log(NamedTuple):
    """A log that is not yet on the disk: a file, or a folder of files by name."""

    name: str
    content: bytes | dict[str, bytes]


def chance(draw: Draw, one_of: int) -> bool:
    """True in one of so many logs; false is what hypothesis ends with when it makes an example simple."""
    return draw(st.integers(0, one_of - 1)) == one_of - 1


def place(draw: Draw, length: int) -> int:
    """An index below ``length``."""
    return draw(st.integers(0, max(length - 1, 0)))


def reordered(draw: Draw, records: Sequence[T]) -> list[T]:
    """The records with some dropped, repeated, exchanged, reversed or moved; often as they are."""
    made = list(records)
    for _ in range(draw(st.integers(0, MOST)) if chance(draw, 2) else 0):
        if not made:
            break
        i, j = sorted((place(draw, len(made)), place(draw, len(made))))
        part = made[i : j + 1]
        match draw(st.sampled_from(("drop", "cut", "repeat", "many", "swap", "reverse", "move"))):
            case "drop":
                del made[i]
            case "cut":
                del made[i : j + 1]
            case "repeat":
                made[j:j] = part
            case "many":
                made[i:i] = [made[i]] * 200
            case "swap":
                made[i], made[j] = made[j], made[i]
            case "reverse":
                made[i : j + 1] = part[::-1]
            case "move":
                made = made[:i] + made[j + 1 :] + part
    return made


def bytes_altered(draw: Draw, data: bytes, other: bytes = b"") -> bytes:
    """The bytes with bits flipped, parts written over, cut out or put in, or ``other`` behind; often as they are."""
    made = bytearray(data)
    for _ in range(draw(st.integers(0, MOST)) if chance(draw, 2) else 0):
        if not made:
            break
        at = place(draw, len(made))
        match draw(
            st.sampled_from(("bit", "byte", "bits", "over", "insert", "remove", "head", "end", "zeros", "behind"))
        ):
            case "bit":
                made[at] ^= 1 << draw(st.integers(0, 7))
            case "byte":
                made[at] = draw(st.integers(0, 255))
            case "bits":
                for _ in range(20):
                    made[place(draw, len(made))] ^= 1 << draw(st.integers(0, 7))
            case "over":
                new = draw(
                    st.binary(min_size=1, max_size=16) | st.sampled_from((b"\xff" * 8, b"\0" * 8, b"\x7f\xff\xff\xff"))
                )
                made[at : at + len(new)] = new
            case "insert":
                made[at:at] = draw(st.binary(max_size=60))
            case "remove":
                del made[at : at + draw(st.integers(1, 300))]
            case "head":
                del made[: at // 4]
            case "end":
                del made[at:]
            case "zeros":
                made[at : at + 512] = bytes(512)
            case "behind":
                made += other or data
    return bytes(made)


@st.composite
def named(draw: Draw, suffixes: tuple[str, ...], contents: st.SearchStrategy[Any]) -> Log:
    """A log of these contents, under a name that may be a trick."""
    content = draw(contents)
    return Log(draw(stems) + draw(st.sampled_from(suffixes)), content)
