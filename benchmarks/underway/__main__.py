"""``python -m benchmarks.underway [control] [paths] [dives]``: vehicles with fins and vessels at the surface, measured.

``control`` trains and flies a torpedo and a surface vessel at speed, healthy and with a fault, before and after
adaptation, ``paths`` has them follow paths, and ``dives`` diagnoses dives of the torpedo with a fin that fails.
``--vehicle milliampere`` does the first and the last with a ferry that has azimuth thrusters. Prints Markdown tables
and, with ``--publish``, writes them into docs/results/other-vehicles.md. Policies are kept, so that a killed run goes
on.
"""

import argparse
from pathlib import Path

import torch

from auv_torchrl.paths import PROJECT
from benchmarks import provenance, show_progress
from benchmarks import published as tables
from benchmarks.control.source import STORE
from benchmarks.underway import control, dives, paths

PAGE = PROJECT / "docs" / "results" / "other-vehicles.md"
PARTS = ("control", "paths", "dives")


def main() -> None:
    """Measure the parts that were asked for and print them."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.underway", description=(__doc__ or "").partition("\n\n")[2]
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default all")
    parser.add_argument("--vehicle", default="", help="one with tables of its own: milliampere")
    parser.add_argument("--seeds", type=int, default=control.SEEDS, help="trainings of each vehicle")
    parser.add_argument("--dives", type=int, default=40, help="with a fault")
    parser.add_argument("--healthy", type=int, default=8, help="dives without one")
    parser.add_argument("--seed", type=int, default=0, help="of faults and dives")
    parser.add_argument("--policies", type=Path, default=STORE, help="store of policies")
    parser.add_argument("--publish", action="store_true", help=f"write the tables into {PAGE.name}")
    options = parser.parse_args()
    parts = options.parts or list(PARTS)
    if unknown := set(parts) - set(PARTS):
        parser.error(f"no part named {', '.join(sorted(unknown))}: there are {', '.join(PARTS)}")
    own = f" {options.vehicle}" if options.vehicle else ""
    if odd := [part for part in parts if (PAGE.name, part + own) not in tables.SECTIONS]:
        parser.error(f"vehicle {options.vehicle} has no table of {', '.join(odd)}: name parts that it has one of")
    commits = {}
    if options.publish:
        try:
            measured = {part: tables.SECTIONS[PAGE.name, part + own].measures for part in parts}
            commits = {part: provenance.committed(paths_of) for part, paths_of in measured.items()}
        except ValueError as error:
            parser.error(str(error))
    show_progress()
    torch.set_num_threads(1)
    for part in parts:
        command, lines = _measured(part, options)
        print("\n".join(lines), flush=True)
        if options.publish:
            tables.publish(PAGE, part + own, "\n".join(lines), command, commits[part])


def _measured(part: str, options: argparse.Namespace) -> tuple[str, list[str]]:
    """The command that measures a part of some vehicles, and its table."""
    one = f" --vehicle {options.vehicle}" if options.vehicle else ""
    if part == "dives":
        drawn = f"--dives {options.dives} --healthy {options.healthy} --seed {options.seed}"
        lines = dives.measure(options.dives, options.healthy, options.seed, options.vehicle or dives.VEHICLE)
        return f"python -m benchmarks.underway dives{one} {drawn}", lines
    if part == "paths":
        lines = paths.measure(options.policies, options.seeds)
    else:
        vehicles = (options.vehicle,) if options.vehicle else control.TOGETHER
        lines = control.measure(options.policies, options.seeds, vehicles=vehicles)
    return f"python -m benchmarks.underway {part}{one} --seeds {options.seeds}", lines


if __name__ == "__main__":
    main()
