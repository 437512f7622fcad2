"""A vehicle as a table of Fossen's symbols (Handbook of Marine Craft Hydrodynamics and Motion Control, 2021)."""

from collections.abc import Iterator

from auv_torchrl.export.marks import Described, Kind, Mark
from auv_torchrl.vehicle.fields import GRAVITY

_FORCES, _SPEEDS = "XYZKMN", "uvwpqr"
Row = tuple[str, float, str, Mark]  # symbol, value, unit, where it comes from


def fossen(described: Described) -> str:
    """The table in Markdown: symbol, value, unit, and where each number comes from."""
    counts = dict.fromkeys(Kind, 0)
    lines = ["| symbol | value | unit | where it comes from |", "|---|---:|---|---|"]
    for symbol, value, unit, mark in rows(described):
        counts[mark.kind] += 1
        lines.append(f"| {symbol} | {value:.6g} | {unit} | {mark} |")
    stated = [line for line in described.remarks if line]
    head = [
        f"# {described.name}",
        "",
        f"Written by auv-export from {described.source}. SI; the body's axes are front, right, down. "
        + ", ".join(f"{count} {kind.value}" for kind, count in counts.items())
        + ".",
        "",
        *(
            [*stated, ""]
            if stated
            else ["No calibration is in the file: the error of held-out flight is not known.", ""]
        ),
    ]
    return "\n".join([*head, *lines, ""])


def rows(described: Described) -> Iterator[Row]:
    """The numbers: rigid body, restoring forces, added mass, drag, thrusters."""
    vehicle, mark = described.vehicle, described.mark
    yield "m", float(vehicle.mass), "kg", mark("mass")
    for n, symbol in enumerate(("I_x", "I_y", "I_z")):
        yield symbol, float(vehicle.inertia[n]), "kg m^2, about the centre of mass", mark("inertia", n)
    for field, letter in (("centre_of_mass", "g"), ("centre_of_buoyancy", "b")):
        for n, axis in enumerate("xyz"):
            yield f"{axis}_{letter}", float(vehicle.get(field)[n]), "m", mark(field, n)
    yield "W", float(vehicle.mass) * GRAVITY, "N", mark("mass")
    yield "B", float(vehicle.buoyancy), "N", mark("buoyancy")
    for n in range(6):
        force, speed, turns = _FORCES[n], _SPEEDS[n], n > 2
        yield f"{force}_{speed}dot", -float(described.added_mass[n]), "kg m^2" if turns else "kg", mark("added_mass", n)
        unit = "kg/m" if not turns else "kg m^2"
        yield f"{force}_\\|{speed}\\|{speed}", -float(vehicle.quadratic_drag[n]), unit, mark("quadratic_drag", n)
        for k in range(6):
            if n == k or vehicle.linear_drag[n, k]:
                unit = "kg/s" if not turns and k < 3 else "kg m/s" if turns != (k > 2) else "kg m^2/s"
                yield f"{force}_{_SPEEDS[k]}", -float(vehicle.linear_drag[n, k]), unit, mark("linear_drag", n, k)
    for n in range(vehicle.thrusters):
        unit = "rad" if n in vehicle.servos else "N"
        yield f"K_{n + 1}", float(vehicle.full_thrust[n]), f"{unit} at command 1", mark("full_thrust", n)
        yield f"thrust exponent {n + 1}", float(vehicle.exponent[n]), "1", mark("exponent", n)
        if n in vehicle.fins:
            yield f"A_{n + 1}", float(vehicle.fin_area[n]), "m^2, a fin", mark("fin_area", n)
            yield f"c_L{n + 1}", float(vehicle.fin_lift[n]), "1/rad, slope of its lift", mark("fin_lift", n)
        if n in vehicle.azimuths:
            yield f"thruster turned by {n + 1}", float(vehicle.turns[n]), "its number", mark("turns", n)
