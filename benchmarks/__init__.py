"""What the figures in docs/ are measured with: controllers and training in ``control``, the diagnosis in ``blind``."""

import logging
from pathlib import Path

from auv_torchrl.files import write_whole


def show_progress() -> None:
    """Write what the benchmarks log to stderr; libraries stay silent."""
    logging.basicConfig(format="%(message)s", force=True)
    for ours in ("benchmarks", "__main__"):
        logging.getLogger(ours).setLevel(logging.INFO)


def replace_between(document: Path, begin: str, end: str, text: str) -> None:
    """Replace what stands between two markers of a document.

    Raises:
        ValueError: if the document does not have both markers, in order.
    """
    before, first, rest = document.read_text(encoding="utf-8").partition(begin)
    _, last, after = rest.partition(end)
    if not first or not last:
        raise ValueError(f"{document} has no {begin} followed by {end}: put both where the tables belong")
    write_whole(document, f"{before}{begin}{text}{end}{after}".encode())
