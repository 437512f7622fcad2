"""From a diagnosis to a light: sound, look, or stop."""

from collections.abc import Mapping
from enum import StrEnum
from typing import Any

DEAD = 0.3  # of its nominal thrust: a thruster that gives less, or pushes the other way, is not to be flown with
SURE = 0.9  # probability from which a light is red


class Light(StrEnum):
    """What the owner is to do; the value is shown."""

    SOUND = "sound"
    LOOK = "look"
    STOP = "stop"


def light_of(diagnosis: Mapping[str, Any]) -> Light:
    """The light of a ``diagnosis.json``.

    Sound is a dive without a gap. Stop is a thruster that is dead or reversed, or thrusters that are exchanged, at a
    probability of 0.9 or more. All else is worth a look, a dive that cannot be judged included.
    """
    if diagnosis["verdict"] == "no_gap":
        return Light.SOUND
    return Light.STOP if any(map(_stops, diagnosis.get("effects", []))) else Light.LOOK


def _stops(effect: Mapping[str, Any]) -> bool:
    if effect["probability"] < SURE:
        return False
    gains = [entry["value"] for entry in effect["parameters"].values()]
    return effect["name"] == "thruster_swap" or (effect["name"] == "thruster_gain" and any(g < DEAD for g in gains))
