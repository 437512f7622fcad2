"""``python -m benchmarks.underway [control] [paths] [dives]``: vehicles with fins and vessels at the surface, measured.

``control`` trains and flies a torpedo and a surface vessel at speed, healthy and with a fault, before and after
adaptation, ``paths`` has them follow paths, and ``dives`` diagnoses dives of the torpedo with a fin that fails. Prints
Markdown tables and, with ``--publish``, writes them into docs/results/other-vehicles.md. Policies are kept, so that a
killed run goes on.
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
TRAINED = {"control": control.measure, "paths": paths.measure}


def main() -> None:
    """Measure the parts that were asked for and print them."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.underway", description=(__doc__ or "").partition("\n\n")[2]
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default all")
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
    commits = {}
    if options.publish:
        try:
            commits = {part: provenance.committed(tables.SECTIONS[PAGE.name, part].measures) for part in parts}
        except ValueError as error:
            parser.error(str(error))
    show_progress()
    torch.set_num_threads(1)
    for part in parts:
        if part in TRAINED:
            command = f"python -m benchmarks.underway {part} --seeds {options.seeds}"
            lines = TRAINED[part](options.policies, options.seeds)
        else:
            drawn = f"--dives {options.dives} --healthy {options.healthy} --seed {options.seed}"
            command = f"python -m benchmarks.underway dives {drawn}"
            lines = dives.measure(options.dives, options.healthy, options.seed)
        print("\n".join(lines), flush=True)
        if options.publish:
            tables.publish(PAGE, part, "\n".join(lines), command, commits[part])


if __name__ == "__main__":
    main()
