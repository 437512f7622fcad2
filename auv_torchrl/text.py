"""Text that comes from outside: shown without doing anything to a terminal or a page, and read as a number.

Names of files, parameters, columns and messages, and the texts of firmware, are whatever somebody wrote. Readers pass
them through :func:`printable` where they enter, and numbers through :func:`number` and :func:`whole`.
"""

import re
import unicodedata

MOST_CHARACTERS = 200  # of a name or a text that are shown; ArduPilot's longest text has 64
_WHOLE = re.compile(r"[-+]?\d{1,18}", re.ASCII)  # digits of what fits into 64 bits
_DIGITS = re.compile(r"([0-9]+)")


def printable(text: str, most: int | None = MOST_CHARACTERS) -> str:
    r"""The text with every character spelt out that is none to look at: ``\x1b``, ``\n``, ``\u202e``.

    Those are control characters, line and paragraph separators, what turns the direction of writing or has no width,
    and halves of pairs; a byte of a file name that is no UTF-8 is spelt as the byte. Text that is spelt out already
    stays as it is, and so do spaces of any width.

    Args:
        text: as it was found.
        most: characters to which it is cut, with a remark of how long it was; None never cuts it.
    """
    shown = text if most is None else text[:most]
    if not shown.isprintable():
        shown = "".join(c if c.isprintable() or unicodedata.category(c) == "Zs" else _spelt(c) for c in shown)
    if most is None or (len(shown) <= most and len(text) <= most):
        return shown
    rest = f"… ({len(text):,} characters)"
    return shown[: most - len(rest)] + rest


def within(text: str, most: int) -> str:
    """The text, without its middle where it is longer: an error begins with its cause, and ends in what to do."""
    if len(text) <= most:
        return text
    gone = f" … ({len(text):,} characters) … "
    left = most - len(gone)
    return text[: left - left // 3] + gone + text[len(text) - left // 3 :]


def in_order(name: str) -> list[tuple[int, str]]:
    """A key that sorts names as people count: ``part 2`` before ``part 10``; numbers are those of ASCII digits."""
    parts = enumerate(_DIGITS.split(name))  # what matches stands at the odd places
    bare = ((part.lstrip("0"), odd % 2 == 1) for odd, part in parts)
    return [(len(part), part) if is_number else (-1, part) for part, is_number in bare]


def _spelt(character: str) -> str:
    if "\udc80" <= character <= "\udcff":  # how Python keeps a byte that is no UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def number(text: str) -> float | None:
    """The number that a text spells in ASCII digits, which may be nan or inf; None where it spells none.

    Python's own ``float`` also takes digits of other scripts, and underscores between digits.
    """
    text = text.strip(" \t\r\n\0")
    if not text.isascii() or "_" in text:
        return None
    try:
        return float(text)
    except ValueError:
        return None


def whole(text: str) -> int | None:
    """The whole number that a text spells in up to 18 ASCII digits; None where it spells none."""
    text = text.strip(" \t\r\n\0")
    return int(text) if _WHOLE.fullmatch(text) else None
