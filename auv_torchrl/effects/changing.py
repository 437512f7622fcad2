"""A vehicle on its way through several effects."""

from typing import Any

from auv_torchrl.vehicle import Vehicle


class Changing:
    """A vehicle that several effects change one after the other: a copy for each takes longer than the effect."""

    def __init__(self, whole: Vehicle) -> None:
        self.whole = whole

    def __getattr__(self, name: str) -> Any:
        """Whatever the vehicle has."""
        return getattr(self.whole, name)
