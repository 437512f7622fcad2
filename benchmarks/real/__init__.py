"""``make real``: logs of real vehicles and of firmware, where they are at hand."""

import os
from pathlib import Path

from auv_torchrl.paths import PROJECT

DATA = Path(os.environ.get("AUV_TORCHRL_DATA", PROJECT.parent / "shared" / "data"))
