"""Text that comes from outside: shown without doing anything to a terminal or a page, and read as a number.

Names of files, parameters, columns and messages, and the texts of firmware, are whatever somebody wrote. Readers pass
them through :func:`printable` where they enter, and numbers through :func:`number` and :func:`whole`.
"""

import re
import unicodedata

MOST_CHARACTERS = 200  # of a name or a text that are shown; ArduPilot's longest text has 64
_NUMBER = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?|nan|inf(?:inity)?)", re.ASCII | re.IGNORECASE)
_WHOLE = re.compile(r"[-+]?\d{1,18}", re.ASCII)  # digits of what fits into 64 bits


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


def _spelt(character: str) -> str:
    if "\udc80" <= character <= "\udcff":  # how Python keeps a byte that is no UTF-8
        return f"\\x{ord(character) - 0xDC00:02x}"
    return character.encode("unicode_escape").decode("ascii")


def number(text: str) -> float | None:
    """The number that a text spells in ASCII digits, which may be nan or inf; None where it spells none.

    Python's own ``float`` also takes digits of other scripts, and underscores between digits.
    """
    text = text.strip(" \t\r\n\0")
    return float(text) if _NUMBER.fullmatch(text) else None


def whole(text: str) -> int | None:
    """The whole number that a text spells in up to 18 ASCII digits; None where it spells none."""
    text = text.strip(" \t\r\n\0")
    return int(text) if _WHOLE.fullmatch(text) else None
