"""Marks of changes once the free start and the disturbance of every window have absorbed what they can."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from auv_torchrl.diagnosis.motion.windows import Floats


@dataclass(frozen=True)
class Reduced:
    """Columns on ``W`` windows, and what of each of them the free numbers of a window absorb."""

    responses: Floats  # (W, K, N) in units of the noise
    pull: Floats  # (W, L, N) of each of these on the free numbers
    moved: Floats  # (W, L, N) free numbers that fit each of them best
    _squares: dict[bytes, Floats] = field(default_factory=dict, repr=False)

    def rows(self, some: slice) -> "Reduced":
        """That of some windows."""
        if some == slice(0, len(self.responses)):
            return self
        return Reduced(self.responses[some], self.pull[some], self.moved[some])

    @cached_property
    def size(self) -> Floats:
        """(W,) that is finite where all numbers are."""
        return np.einsum("wkn,wkn->w", self.responses, self.responses) + np.einsum("wln,wln->w", self.pull, self.moved)

    def times(self, other: "Reduced", chosen: np.ndarray) -> Floats:
        """Products (N, M) with other columns over some windows (a boolean mask), the free numbers fitted."""
        mine, its, pull, moved = (
            (rows if chosen.all() else rows[chosen]).reshape(-1, rows.shape[-1])
            for rows in (self.responses, other.responses, self.pull, other.moved)
        )
        return mine.T @ its - pull.T @ moved

    def squares(self, chosen: np.ndarray) -> Floats:
        """Products (N, N) of the columns with each other, worked out once for the same windows."""
        key = chosen.tobytes()
        if key not in self._squares:
            self._squares[key] = self.times(self, chosen)
        return self._squares[key]
