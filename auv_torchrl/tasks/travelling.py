"""Tasks whose reference goes somewhere, so that training episodes can begin on its way."""

from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

from auv_torchrl.tasks.following import Following

if TYPE_CHECKING:
    import torch
    from torch import Tensor


@dataclass(frozen=True)
class Travelling(Following):
    """Episodes of training begin anywhere along the task, those of an evaluation at its beginning."""

    anywhere: bool = True  # training episodes begin anywhere along the task, not only at its beginning

    @abstractmethod
    def draw_anywhere(self, count: int, generator: "torch.Generator") -> "Tensor":
        """Where on the whole way episodes begin, (count,) s along the task, float64."""

    def draw_along(self, count: int, generator: "torch.Generator") -> "Tensor":
        """How far along the task episodes begin, (count,) s, float64."""
        return self.draw_anywhere(count, generator) if self.anywhere else super().draw_along(count, generator)

    def for_evaluation(self, box_m: float | None) -> Self:
        """The same task from its beginning, with all starts uniform in a cube around the reference there."""
        return replace(super().for_evaluation(box_m), anywhere=False)
