"""A recording as a file, complete or not at all."""

from pathlib import Path

import rerun as rr


def write_recording(memory: rr.MemoryRecording, path: Path) -> None:
    """Write what a stream recorded in memory.

    Not by the stream's own ``save``: on a full disk its writer dies, and the next that is logged waits for it for ever.

    Raises:
        OSError: if it cannot be written; nothing is left of it then.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.write_bytes(memory.drain_as_bytes())
    except OSError:
        partial.unlink(missing_ok=True)
        raise
    partial.replace(path)
