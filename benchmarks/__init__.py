"""What the figures in docs/ are measured with: controllers and training in ``control``, the diagnosis in ``blind``."""

import logging


def show_progress() -> None:
    """Write what the benchmarks log to stderr; libraries stay silent."""
    logging.basicConfig(format="%(message)s", force=True)
    for ours in ("benchmarks", "__main__"):
        logging.getLogger(ours).setLevel(logging.INFO)
