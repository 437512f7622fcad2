"""Every effect, in one registry that scenarios, randomization, diagnosis and reports read."""

from auv_torchrl.effects import actuation, body, external, flow, mounting, response, sensing, servos
from auv_torchrl.effects.effect import Effect, Origin, Parameter
from auv_torchrl.registry import Registry
from auv_torchrl.settings import choices

EFFECTS = Registry(  # in the order in which they are applied
    "effects",
    Effect,
    (
        *actuation.EFFECTS,
        *servos.EFFECTS,
        *response.EFFECTS,
        *body.EFFECTS,
        *flow.EFFECTS,
        *external.EFFECTS,
        *sensing.EFFECTS,
        *mounting.EFFECTS,
    ),  # fmt: skip
)


def get_effect(name: object) -> Effect:
    """The effect of that name.

    Raises:
        ValueError: if there is none; the message lists those there are.
    """
    if not isinstance(name, str) or name not in EFFECTS:
        raise ValueError(f"no effect named {name!r}: {choices([name], EFFECTS)}")
    return EFFECTS[name]


__all__ = ["EFFECTS", "Effect", "Origin", "Parameter", "get_effect"]
