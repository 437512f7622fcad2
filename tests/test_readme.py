"""README: short, and every command in it is taken as it stands."""

import re
import shlex
import shutil
import subprocess
import tomllib

import pytest
from hydra import compose as compose_by_hydra
from hydra import initialize_config_dir

from auv_torchrl.command.compose import compose
from auv_torchrl.diagnosis.command import calibrate
from auv_torchrl.experiment import schema
from auv_torchrl.export import command as export
from auv_torchrl.flightlog.command import _parsed
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.monitoring import command as diagnose
from auv_torchrl.page.command import parser
from auv_torchrl.paths import CONF, PROJECT

README = (PROJECT / "README.md").read_text(encoding="utf-8")
LONGEST = 8_000  # bytes
PLAIN = {"auv-diagnose": diagnose, "diagnose.py": diagnose, "auv-calibrate": calibrate, "calibrate.py": calibrate}
PLAIN["auv-export"] = export
BLOCKS = re.findall(r"^```\n(.*?)^```", README, re.S | re.M)
LINES = [line for block in BLOCKS for line in block.splitlines() if line and not line.startswith(" ")]


def test_it_is_read_at_one_sitting():
    """One screen for who has a vehicle, one for who does research, and what the program cannot do."""
    assert len(README.encode()) <= LONGEST
    assert {"## You have a vehicle", "## You do research", "## Contents", "## What it cannot do"} <= {
        *README.splitlines()
    }


@pytest.mark.parametrize("line", LINES)
def test_a_command_is_taken_as_it_stands(line):
    """Its files need not be there; its options, settings and names are those that there are."""
    program, *words = shlex.split(line, comments=True)
    if program == "python":
        program, *words = words
    if program == "make":
        assert shutil.which("make") is None or subprocess.run(["make", "-n", *words], cwd=PROJECT).returncode == 0
    elif program in PLAIN:
        read = PLAIN[program].LINE.overrides(words)
        assert read
        compose(PLAIN[program].LINE.name, read, PLAIN[program].schemas())
    elif program == "train.py":
        schema.register()
        check_config_files()
        with initialize_config_dir(str(CONF), version_base="1.3"):
            compose_by_hydra("train", words)
    elif program == "auv-log":
        _parsed(words)
    elif program == "auv-page":
        parser().parse_args(words)
    elif program == "pip":
        install, what = words
        extras = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        assert install == "install" and what in {".", *(f".[{name}]" for name in extras)}
    else:
        assert (PROJECT / program).is_file()
