"""What docs/diagnosis.md shows works."""

import re

import numpy as np
import torch

from auv_torchrl.blind.outside import OUTSIDE
from auv_torchrl.blind.report import BEGIN, END
from auv_torchrl.effects import Effect
from auv_torchrl.paths import PROJECT
from auv_torchrl.vehicle import load_vehicle

DOCUMENT = PROJECT / "docs" / "diagnosis.md"


def test_the_example_effect_is_an_effect():
    """The entry of the document changes the drag, and at its nominal value nothing."""
    code = next(block for block in re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.S) if "Effect(" in block)
    names: dict = {}
    exec(code, names)  # the document's own lines
    effect, vehicle = names["fouling"], load_vehicle("paper")
    assert isinstance(effect, Effect)
    assert (effect.apply(vehicle, effect.nominal(vehicle)) == vehicle).all()
    fouled = effect.apply(vehicle, {"factor": torch.tensor([1.0, 2.0])})
    np.testing.assert_allclose(fouled.linear_drag[1], 2 * vehicle.linear_drag)
    np.testing.assert_allclose(fouled.quadratic_drag[1], 2 * vehicle.quadratic_drag)


def test_the_document_has_room_for_the_tables_and_counts_what_is_flown():
    """The markers are there, and the number of effects outside the library is the one that is flown."""
    text = DOCUMENT.read_text()
    assert text.index(BEGIN) < text.index(END)
    assert {11: "eleven"}[len(OUTSIDE)] in text
