"""One colour per controller, in figures and recordings: Okabe and Ito's colours, told apart by colour-blind readers."""

U_S = "#D55E00"  # vermillion: the source policy on the target vehicle
U_T = "#0072B2"  # blue: the adapted policy on the target vehicle
NOMINAL = "#009E73"  # green: the source policy on the vehicle it was trained for
NEUTRAL = "#7F7F7F"  # grey: the target, grids, references
SERIES = ("#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7", "#999999")  # thrusters
MOMENT = {  # of a flight in which the vehicle changes
    "CHANGE": "#000000",
    "FELT": "#7F7F7F",
    "NOTICED": "#E69F00",
    "SETTLED": "#CC79A7",
    "FROZEN": "#D55E00",
    "RECOVERED": "#009E73",
}
CONTROLLER = {"u_s": U_S, "u_t": U_T, "nominal": NOMINAL}
LABEL = {
    "nominal": "u_s on the nominal vehicle",
    "u_s": "u_s on the target",
    "u_t": "u_t on the target",
}


def rgb(colour: str, alpha: int = 255) -> tuple[int, int, int, int]:
    """Red, green, blue and alpha from 0 to 255 of a ``#RRGGBB`` colour."""
    return (int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16), alpha)
