"""Runs diagnose.py on many command lines in one process: a list of them in, a list of (code, out, err) out, as JSON.

A process of its own, because Hydra sets up logging anew and absl then closes the streams that pytest captures with.
"""

import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout

from diagnose import main


def answer(arguments: list[str]) -> tuple[int, str, str]:
    """Exit code and output of one command line."""
    sys.argv = ["diagnose.py", *arguments]
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err):
        try:
            main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    return code, out.getvalue(), err.getvalue()


if __name__ == "__main__":
    print(json.dumps([answer(arguments) for arguments in json.load(sys.stdin)]))
