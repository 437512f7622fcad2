"""Which of the shipped vehicles hover, and which effects can act on those: they have no servos."""

from auv_torchrl.effects import EFFECTS, servos
from auv_torchrl.paths import config_names
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle

HOVERING = [name for name in config_names("vehicle") if load_vehicle(name).mixer[:, CONTROLLED_INDEX].any(axis=0).all()]
SERVO_EFFECTS = {effect.name for effect in servos.EFFECTS}
ACTING = {name: effect for name, effect in EFFECTS.items() if name not in SERVO_EFFECTS}


def one_for(effect: str, otherwise: str) -> str:
    """A vehicle that an effect of that name can act on: one with fins or azimuth thrusters for those of theirs."""
    if effect not in SERVO_EFFECTS:
        return otherwise
    return "remus100" if effect.startswith("fin") else "milliampere"
