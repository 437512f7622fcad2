"""ArduSub's program, in a folder of its own; the variable ARDUSUB names it, and no part of it is in this repository."""

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

VARIABLE = "ARDUSUB"
RATE_HZ = 400
LOGS = "logs"
# What the simulated vehicle needs; docs/how-to/fly-behind-ardusub.md has the reasons.
PARAMETERS = {
    "SIM_RATE_HZ": RATE_HZ,
    "BARO_EXT_BUS": 1,
    "BARO_SPEC_GRAV": 1.024,
    "BATT_MONITOR": 0,
    "SIM_BARO_RND": 0.02,
    "BTN4_FUNCTION": 4,  # disarm: ArduSub does not arm without such a button
    **{f"COMPASS_OFS{n}_{axis}": at for n in ("", "2", "3") for axis, at in zip("XYZ", (5, 13, -18), strict=True)},
}
_HOME = "33.81,-118.39,0,0"  # at altitude 0, the surface
_PARAMETERS, _SAID = "link.parm", "ardusub.txt"


def program() -> Path:
    """ArduSub's program.

    Raises:
        ValueError: where the variable does not name one.
    """
    named = os.environ.get(VARIABLE, "")
    path = Path(named).resolve()
    if not named or not path.is_file():
        raise ValueError(f"{VARIABLE} is {named!r}: let it name ArduSub's program (docs/how-to/fly-behind-ardusub.md)")
    return path


class Firmware:
    """One process of ArduSub, which asks for physics at a port, and speaks MAVLink to another one.

    Args:
        folder: of its parameters and logs; a folder in which it ran before has those that were set then.
        physics: UDP port of the physics, on the loopback.
        ground: UDP port of the ground station, likewise.
        parameters: where they differ from :data:`PARAMETERS`; only of a folder that is new.
    """

    def __init__(self, folder: Path, physics: int, ground: int, parameters: Mapping[str, float]):
        self.folder = folder
        is_new = not (folder / _PARAMETERS).exists()
        folder.mkdir(parents=True, exist_ok=True)
        if is_new:
            told = {**PARAMETERS, **parameters}
            (folder / _PARAMETERS).write_text("".join(f"{name} {value:g}\n" for name, value in told.items()))
        line = [str(program()), "--model", "JSON:127.0.0.1", "--sim-port-out", str(physics), "--home", _HOME, "-I0",
                "--serial0", f"udpclient:127.0.0.1:{ground}", "--serial1", "none", "--serial2", "none",
                "--defaults", _PARAMETERS]  # fmt: skip
        self._said = (folder / _SAID).open("ab")
        try:
            self._process = subprocess.Popen(
                [*line, *(("-w",) if is_new else ())], cwd=folder, stdout=self._said, stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL, preexec_fn=_end_with_parent,
            )  # fmt: skip
        except BaseException:
            self._said.close()
            raise

    @property
    def ended(self) -> int | None:
        """Its exit status; None while it runs."""
        return self._process.poll()

    def logs(self) -> list[Path]:
        """What it wrote so far, oldest first."""
        return sorted((self.folder / LOGS).glob("*.BIN"))

    def close(self) -> None:
        """End it: while it waits for physics it obeys no other signal."""
        self._process.kill()
        self._process.wait()
        self._said.close()


def _end_with_parent() -> None:
    """Ask Linux to end this process with its parent: ArduSub does not notice that while it waits for physics."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
