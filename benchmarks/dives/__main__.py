"""``python -m benchmarks.dives``: fly many dives, follow them, and count how early and how wrongly an alarm is raised.

Vehicles whose files are a few per cent wrong fly dives of 90 s, with another trim, current and voltage each time. Of
some a thruster fades by 1 % a dive from the fourth dive on; others stay as they are. Prints Markdown tables and, with
``--publish``, writes them into docs/results/dives.md. Another ``--seed`` draws other vehicles, pilots and days.
"""

import argparse
import logging
import platform
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.monitoring.changes import ChangeRecord, find_changes
from auv_torchrl.monitoring.dive_history import label_of
from auv_torchrl.monitoring.dive_record import follow_dive, learn_reference
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import Vehicle, load_vehicle
from benchmarks import published as tables
from benchmarks import show_progress
from benchmarks.dives.fly import Series, fly_series
from benchmarks.scoring import NEAR, Named, Score, score

log = logging.getLogger(__name__)
PAGE, SECTION = PROJECT / "docs" / "results" / "dives.md", "dives"
VEHICLE = "paper"
REFERENCE, FADES_OVER, FADE = 3, 20, 0.01
DIVES_PER_FALSE_ALARM = 1000.0
MUST, AIM = 0.15, 0.08


@dataclass(frozen=True)
class Outcome:
    """What was found over one series."""

    what: str
    record: ChangeRecord
    seconds: float  # of the processor
    fading: str | None  # label of the parameter that fades

    @property
    def score(self) -> Score:
        """By the rule of all benchmarks: that a thruster fades, which one, from the fourth dive on, by how much."""
        record = self.record
        if self.fading is None:
            return score(not record.alarms and not record.changes, (), ())
        named = []
        for change in record.changes:
            shift, alone = change.shifts[0], self.labels([change.row]) == self.fading
            near = shift.is_drift and abs(shift.size + FADE) <= NEAR * FADE
            exact = alone and not change.rivals and near and shift.low <= REFERENCE <= shift.high
            there = self.fading in [self.labels([row]) for row in (change.row, *change.rivals)]
            named.append(Named(change.probability, frozenset((self.fading,) if there else ()), exact))
        return score(bool(record.alarms), (self.fading,), named)

    def labels(self, rows: Sequence[int]) -> str:
        """Parameters as people call them."""
        return ", ".join(label_of(self.record.series.parameters[row]) for row in rows)


def run(what: str, vehicle: Vehicle, series: Series, fading: str | None = None) -> Outcome:
    """Fly a series, calibrate on its first dives, follow all of them."""
    begin = time.process_time()
    logs = fly_series(vehicle, series)
    reference = learn_reference(logs[:REFERENCE], vehicle, load_settings())
    dives = []
    for flight in logs:
        dives.append(follow_dive(flight, reference))
        log.info("%s: %s", what, flight.name)
    record = find_changes(dives, reference.baseline, REFERENCE, DIVES_PER_FALSE_ALARM)
    return Outcome(what, record, time.process_time() - begin, fading)


def faded(thruster: int, seed: int, over: int = FADES_OVER) -> Series:
    """Dives of which one thruster fades behind the reference."""
    gain = np.append(np.ones(REFERENCE), 1 - FADE * np.arange(1, over + 1))
    return Series(REFERENCE + over, seed, changes={"thruster_gain": {f"gain_{thruster}": gain}})


def lost_at(outcome: Outcome) -> float:
    """The thrust that was lost when an alarm was first raised; all of it where none was."""
    alarms = outcome.record.alarms
    return FADE * (alarms[0].dive - REFERENCE + 1) if alarms else 1.0


def fading_table(outcomes: Sequence[Outcome]) -> list[str]:
    """A row per fading thruster."""
    head = (
        "fading", "thrust lost at the first alarm", "it names", "at the end", "loss per dive", "since dive", "right",
        "half right",
    )  # fmt: skip
    lines = [f"| {' | '.join(head)} |", "|---|---:|---|---|---|---|---|---|"]
    for outcome in outcomes:
        record = outcome.record
        alarm = record.alarms[0] if record.alarms else None
        named = outcome.labels([alarm.row, *alarm.rivals]) if alarm else "–"
        found = [outcome.labels([change.row, *change.rivals]) for change in record.changes]
        size, since = "–", "–"
        if record.changes:
            shift = record.changes[0].shifts[0]
            size = f"{-100 * shift.size:.2f} ± {196 * shift.deviation:.2f} %" if shift.is_drift else "a step"
            since = f"{shift.begin + 1} ({shift.low + 1} to {shift.high + 1})"
        lost = f"{100 * lost_at(outcome):.0f} %" if alarm else "no alarm"
        cells = (outcome.what, lost, named, "; ".join(found) or "–", size, since, *outcome.score.cells)
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def sound_line(outcomes: Sequence[Outcome]) -> str:
    """How many false alarms there were."""
    dives = sum(outcome.record.series.value.shape[1] - REFERENCE for outcome in outcomes)
    names = [outcome.labels([alarm.row]) for outcome in outcomes for alarm in outcome.record.alarms]
    said = f" ({', '.join(names)})" if names else ""
    right = sum(outcome.score is Score.RIGHT for outcome in outcomes)
    return (
        f"{len(outcomes)} sound vehicles, {dives} dives behind the reference; false alarms: {len(names)}{said}; "
        f"vehicles of which nothing is said: {right}."
    )


def report(fading: Sequence[Outcome], sound: Sequence[Outcome], seed: int) -> list[str]:
    """All that was measured, as Markdown."""
    worst = max((lost_at(outcome) for outcome in fading), default=0.0)
    count = sum(outcome.record.series.value.shape[1] for outcome in (*fading, *sound))
    seconds = sum(outcome.seconds for outcome in (*fading, *sound))
    return [
        *fading_table(fading),
        "",
        f"Latest first alarm: {100 * worst:.0f} % of the thrust lost (must {100 * MUST:.0f} %, aim {100 * AIM:.0f} %).",
        sound_line(sound),
        f"Threshold for one false alarm in {DIVES_PER_FALSE_ALARM:g} dives. Seed {seed}, vehicle `{VEHICLE}`, "
        f"{seconds / max(count, 1):.1f} CPU s a dive, calibration included, on {platform.machine()}.",
    ]  # fmt: skip


def publish(lines: Sequence[str], seed: int, commit: str) -> None:
    """Write the tables into the page, between its marks."""
    tables.publish(PAGE, SECTION, "\n".join(lines), f"python -m benchmarks.dives --seed {seed}", commit)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fading", type=int, default=6, help="vehicles of which a thruster fades, each another one")
    parser.add_argument("--sound", type=int, default=4, help="vehicles that stay as they are")
    parser.add_argument("--dives", type=int, default=50, help="of each of these, behind the reference")
    parser.add_argument("--publish", action="store_true", help=f"write the tables into {PAGE.name}")
    options = parser.parse_args()
    commit = tables.commit_to_name(parser, PAGE, SECTION, options.publish)
    show_progress()
    torch.set_num_threads(1)
    vehicle = load_vehicle(VEHICLE)
    numbered = [i % vehicle.thrusters + 1 for i in range(options.fading)]
    seeds = [1000 * options.seed + i for i in range(options.fading + options.sound)]
    fading = [
        run(f"thruster {t}", vehicle, faded(t, s), f"thruster gain {t}") for t, s in zip(numbered, seeds, strict=False)
    ]
    sound = [run("none", vehicle, Series(REFERENCE + options.dives, s)) for s in seeds[options.fading :]]
    lines = report(fading, sound, options.seed)
    print("\n".join(lines))
    if options.publish:
        publish(lines, options.seed, commit)


if __name__ == "__main__":
    main()
