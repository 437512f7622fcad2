"""A recording as a file, complete or not at all."""

from pathlib import Path

import rerun as rr

from auv_torchrl.files import write_whole


def write_recording(memory: rr.MemoryRecording, path: Path) -> None:
    """Write what a stream recorded in memory.

    Not by the stream's own ``save``: on a full disk its writer dies, and the next that is logged waits for it for ever.

    Raises:
        OSError: if it cannot be written; nothing is left of it then.
    """
    write_whole(path, memory.drain_as_bytes())
