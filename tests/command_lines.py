"""Runs a program on many command lines in one process, which imports everything once.

A process of its own, because Hydra sets up logging anew and absl then closes the streams that pytest captures with.
"""

import importlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout

from auv_torchrl.paths import PROJECT

Answer = tuple[int, str, str]  # exit code, output, errors


def answers_of(program: str, lines: dict[str, list[str]]) -> dict[str, Answer]:
    """What ``program``, a module with a function main, answers to each of the command lines."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "tests.command_lines", program]
    given = json.dumps(list(lines.values()))
    run = subprocess.run(command, capture_output=True, text=True, input=given, cwd=PROJECT, env=environment)
    assert run.returncode == 0, run.stderr
    return dict(zip(lines, map(tuple, json.loads(run.stdout.splitlines()[-1])), strict=True))


def answer(main: Callable[[], None], arguments: list[str]) -> Answer:
    """Exit code and output of one command line."""
    sys.argv = ["program", *arguments]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    return code, out.getvalue(), err.getvalue()


if __name__ == "__main__":
    entry = importlib.import_module(sys.argv[1]).main
    print(json.dumps([answer(entry, arguments) for arguments in json.load(sys.stdin)]))
