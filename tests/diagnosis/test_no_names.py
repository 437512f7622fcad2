"""What the diagnosis must know of single effects, the effects declare."""

import ast
import re
from pathlib import Path

from auv_torchrl import diagnosis
from auv_torchrl.effects import EFFECTS
from auv_torchrl.vehicle import load_vehicle

ROOT = Path(diagnosis.__file__).parent


def test_the_diagnosis_asks_for_no_effect_by_its_name():
    """No string of its code is the name of an effect or holds one, docstrings and the drawing of the report aside."""
    found = []
    for path in sorted(ROOT.rglob("*.py")):
        if path.parent.name == "report":  # words and classes of a drawing: the hull, a payload
            continue
        tree = ast.parse(path.read_text())
        documents = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
                whole = {node.value} | {word for word in re.findall(r"\w+", node.value) if "_" in word}
                found += [f"{path.name}:{node.lineno} {name}" for name in sorted(whole & set(EFFECTS))]
    assert not found


def test_a_limit_within_the_dead_band_is_said_to_be_a_dead_thruster():
    """Where no command gets through, the effect itself says that the thruster gives nothing."""
    vehicle = load_vehicle("paper")
    same_as = EFFECTS["thrust_limit"].trial.same_as
    assert same_as is not None
    band = float(vehicle.dead_band.min())
    assert same_as(vehicle, "limit_2", 0.9 * band) == ("thruster_gain", "gain_2", 0.0)
    assert same_as(vehicle, "limit_2", 1.1 * band) is None
