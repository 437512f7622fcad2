"""An effect of one's own, as its file."""

FOULING = """
from auv_torchrl.effects.effect import Effect, Origin, Parameter, changed


def _fouling(vehicle, factor):
    return changed(
        vehicle,
        linear_drag=factor[..., None, None] * vehicle.linear_drag,
        quadratic_drag=factor[..., None] * vehicle.quadratic_drag,
    )


fouling = Effect(
    name="fouling",
    origin=Origin.FLOW,
    meaning="all drag times one factor: growth on the hull",
    source="Schultz 2007, resistance of fouled hulls",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 5.0, "drag is {value:.2f} times the nominal one"),),
    change=_fouling,
)

EFFECTS = (fouling,)
"""
