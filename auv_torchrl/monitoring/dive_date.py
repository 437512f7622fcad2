"""When a dive began, as far as the name of its file says."""

import re
from datetime import datetime
from pathlib import Path

_DATE = re.compile(
    r"(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?:[-_. T]?([0-2]\d)[-_.:h]?([0-5]\d)(?:[-_.:]?([0-5]\d))?)?", re.ASCII
)


def begun(path: Path) -> str:
    """When a dive began, as the name of its file says; empty where the name has no date."""
    found = _DATE.search(path.name)
    if found is None:
        return ""
    numbers = [int(part) for part in found.groups() if part is not None]
    try:
        moment = datetime(*numbers)  # pyright: ignore[reportArgumentType]  # three to six numbers
    except ValueError:
        return ""
    return moment.isoformat(sep=" ", timespec="minutes") if len(numbers) > 3 else moment.date().isoformat()
