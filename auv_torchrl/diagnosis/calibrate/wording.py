"""What is said of a calibration: on the console, and at the top of the vehicle file."""

from collections.abc import Mapping, Sequence
from typing import Any

from auv_torchrl.command.errors import one_line
from auv_torchrl.diagnosis.calibrate.crossvalidation import Unseen, pooled, why_not
from auv_torchrl.diagnosis.calibrate.healthy import Calibration
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.thresholds import MOST_EFFECTS
from auv_torchrl.diagnosis.verdict import Errors
from auv_torchrl.quantities import percent, quantity, words

SHOWN_S = (2.0, 5.0)  # horizons that are printed
KINDS = (("position_m", "m"), ("yaw_rad", "rad"), ("velocity", "m/s"))
NAMES = {"position_m": "position", "yaw_rad": "heading", "velocity": "velocity"}


def console_lines(
    sound: Calibration, flights: Sequence[Unseen], left_out: Sequence[Unseen], settings: Settings
) -> list[str]:
    """What a person reads who called the command."""
    lines = [str(finding) for finding in sound.findings]
    if 0 < len(sound.strays) <= MOST_EFFECTS:
        lines.append(
            f"the file is off in {', '.join(words(name) for name in sound.strays)} alone: if that has not "
            "always been so, it is a fault, and no calibration; diagnose.py log=... tells"
        )
    lines += [*odd_lines(left_out), *flight_lines(flights), *no_better_lines(flights)]
    lines += [
        f"{flight.name}: departs from what the others say (chi-square {flight.excess:.2f} per number)"
        for flight in flights
        if flight.excess > settings.excess
    ]
    return lines


def head_lines(about: Mapping[str, Any], flights: Sequence[Unseen], left_out: Sequence[Unseen]) -> list[str]:
    """The top of the file: from what it was made, and how well it predicts what it has not seen."""
    before, after = pooled(flights)
    return [
        one_line(f"Calibrated on {', '.join(about['logs'])} ({about['seconds']:g} s) from vehicle={about['vehicle']}, "
                 f"{about['made']} UTC, auv_torchrl {about['version']}."),
        f"Unseen flight is predicted with {percent(after / before)} of the error of that vehicle:",
        *flight_lines(flights),
        *no_better_lines(flights),
        *odd_lines(left_out),
    ]  # fmt: skip


def odd_lines(left_out: Sequence[Unseen]) -> list[str]:
    """Flights that are not like the others."""
    return [
        one_line(
            f"{flight.name} is not like the other flights (chi-square {flight.excess:.3g} per number under what they "
            "say, 1 is noise): left out. Diagnose it with the calibrated vehicle"
        )
        for flight in left_out
    ]


def no_better_lines(flights: Sequence[Unseen]) -> list[str]:
    """Flights that gain nothing, where the others gain enough for all: else nothing is kept, and that is said."""
    if why_not(flights):
        return []
    return [
        one_line(
            f"{flight.name} is predicted no better than by the file ({flight.after:.2f} floors of error, "
            f"{flight.before:.2f} before): others do not show what it does. Give more flights like it"
        )
        for flight in flights
        if not flight.gains
    ]


def refusal(reason: str, vehicle: str, flights: Sequence[Unseen]) -> str:
    """That nothing is kept, and what to do: fly on as before, and give what may help where some flights gain."""
    behind = ", ".join(flight.name for flight in flights if not flight.gains)
    some = any(flight.gains for flight in flights) and behind
    until = f" until there are more flights like {behind}: the others do not show what it does" if some else ""
    return f"{reason}; nothing was written: go on with vehicle={vehicle}{until}"


def flight_lines(flights: Sequence[Unseen]) -> list[str]:
    """Errors of each flight as the others predict it, before and after."""
    found = []
    for flight in flights:
        parts = []
        for kind, unit in KINDS:
            errors: Errors | None = getattr(flight, kind)
            if errors is None:
                continue
            told = [
                f"{quantity(errors.before[place], unit)} → {quantity(errors.after[place], unit)} at {horizon:g} s"
                for place, horizon in enumerate(flight.horizons_s)
                if horizon in SHOWN_S
            ]
            parts += [f"{NAMES[kind]} {', '.join(told)}"] if told else []
        found.append(one_line(f"{flight.name}: {'; '.join(parts) or 'too short for 2 s'}"))
    return found
