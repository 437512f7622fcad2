"""Measure the figures of docs/results/benchmarks.md, all of them or some: python -m benchmarks.control [NAME ...].

Each part is a module of this folder that prints Markdown; its output replaces the section of the same name in
docs/results/benchmarks.md, with the commit, the versions and the machine it was measured on. Parts that fail leave
their section alone. A module of its own, ``python -m benchmarks.control.NAME``, prints and writes nothing.
"""

import argparse
import datetime
import os
import platform
import re
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from auv_torchrl.paths import PROJECT
from benchmarks import provenance
from benchmarks.published import SECTIONS, publish

DOCUMENT = PROJECT / "docs" / "results" / "benchmarks.md"
PARTS = {  # module: what it measures
    "env_steps": "Control steps per second of the fleets",
    "simulated_seconds": "Simulated seconds per second of one core",
    "sac_updates": "SAC updates per second",
    "time_to_error": "Training time to an error",
    "agents": "Agents",
    "table2": "The paper's Table 2",
    "fault_recovery": "Recovery from a fault in flight",
    "tank_run": "The paper's tank run",
    "tracking": "Paths",
    "tasks": "Every agent in every scenario",
    "comparison": "All methods in all scenarios",
}
PACKAGES = ("torch", "torchrl", "tensordict", "mujoco", "dm-control", "gymnasium", "numpy")
RIVALS = {  # packages that parts measure, too
    "sac_updates": ("stable-baselines3",),
    "time_to_error": ("stable-baselines3",),
    "simulated_seconds": ("stable-baselines3", "jax"),
}


def machine(packages: Sequence[str] = PACKAGES) -> str:
    """One line on the versions and the machine, for the head of a section."""
    versions = ", ".join(f"{name} {version(name)}" for name in packages)
    load = os.getloadavg()[0]
    today = datetime.datetime.now(datetime.UTC).date()
    return (
        f"Measured {today} with Python {platform.python_version()}, {versions}; "
        f"{os.cpu_count()} cores of {processor()}, load at the start {load:.1f}."
    )


def processor() -> str:
    """The processor's own name where the system tells it."""
    information = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*: (.*)", information.read_text()) if information.exists() else None
    return found[1] if found else platform.processor() or platform.machine()


def measure(name: str) -> str | None:
    """Run one part, echo what it prints, and return it; None if it failed."""
    print(f"## {PARTS[name]} (benchmarks/control/{name}.py)", flush=True)
    lines = []
    command = [sys.executable, "-u", "-m", f"benchmarks.control.{name}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=PROJECT) as part:
        assert part.stdout is not None
        for line in part.stdout:
            print(line, end="", flush=True)
            lines.append(line)
    if part.returncode:
        print(
            f"benchmarks.control.{name} failed with exit code {part.returncode}: its section stays as it was",
            file=sys.stderr,
        )
        return None
    return "".join(lines).strip()


def main() -> int:
    """Measure the parts that were asked for; the exit code is the number of those that failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.control", description="Measure the figures of docs/results/benchmarks.md."
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"parts to measure, of {', '.join(PARTS)}; default all"
    )
    names = parser.parse_args().names or list(PARTS)
    if unknown := set(names) - set(PARTS):
        parser.error(f"no part named {', '.join(sorted(unknown))}: there are {', '.join(PARTS)}")
    try:
        for package in (*PACKAGES, *(rival for name in names for rival in RIVALS.get(name, ()))):
            version(package)
        commits = {name: provenance.committed(SECTIONS[DOCUMENT.name, name].measures) for name in names}
    except PackageNotFoundError as error:
        parser.error(f"{error.name} is not installed: pip install --constraint constraints.txt --editable '.[bench]'")
    except ValueError as error:
        parser.error(f"{error}; python -m benchmarks.control.NAME prints without publishing")
    failed = 0
    for name in names:
        where = machine((*PACKAGES, *RIVALS.get(name, ())))
        text = measure(name)
        if text is None:
            failed += 1
            continue
        command = f"python -m benchmarks.control {name}"
        publish(DOCUMENT, name, f"{where}\n\n{text}", command, commits[name])
    return failed


if __name__ == "__main__":
    sys.exit(main())
