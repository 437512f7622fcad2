"""One log given to mujoco.sysid: all numbers of a model free at once, its optimizer, its confidence intervals."""

import io
import time
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any, Protocol

import numpy as np

from benchmarks.versus.parameters import Free
from benchmarks.versus.toolbox import sysid
from benchmarks.versus.windows import Windows, wrapped

# Of its three, the one that gets nearest on logs tried beforehand; its default one ended early on half of them.
OPTIMIZER = "scipy_parallel_fd"
ROUNDS = 20  # of the optimizer at most; later ones change the cost by less than a hundredth
SETTLED = {"xtol": 1e-4, "ftol": 1e-3}  # step of the numbers and share of the cost below which it ends
DIVERGED = 10.0  # m, that a vehicle counts as off by whose flight has diverged


class Model(Protocol):
    """What a fit needs of a model."""

    name: str
    free: list[Free]

    def parameters(self) -> Any:
        """All numbers that are free, where the fit begins."""
        ...

    def residual(self, windows: Windows) -> Callable[..., Any]:
        """What is minimised."""
        ...

    def predict(self, params: Any, windows: Windows) -> np.ndarray:
        """What is reported of windows (W, S, 4)."""
        ...


def fit(model: Model, windows: Windows, held: Windows) -> dict[str, Any]:
    """What a fit says, of plain types: each number with its interval, its time, and errors of held-out flight."""
    began = time.process_time()
    residual, params = model.residual(windows), model.parameters().move_off_bounds()  # as it advises
    with redirect_stdout(io.StringIO()):  # where its optimizer writes its rounds
        found, result = sysid.optimize(
            params, residual, OPTIMIZER, verbose=False, max_iters=ROUNDS, x_scale="jac", **SETTLED
        )
    left = residual(found.as_vector(), found.copy())[0]
    _, half = sysid.calculate_intervals(left, result.jac)
    seconds = time.process_time() - began
    numbers = [
        {**one._asdict(), "value": float(value), "half": float(width) if np.isfinite(width) else None}
        for one, value, width in zip(model.free, found.as_vector(), half, strict=True)
    ]
    nominal = model.parameters()
    nominal.update_from_vector(np.array([one.nominal for one in model.free]))
    return {
        "numbers": numbers,
        "cpu_s": seconds,
        "left": float(np.sqrt(np.mean(np.concatenate(left) ** 2))),  # standard deviations of the sensors
        "before_m": error_m(model.predict(nominal, held), held),
        "after_m": error_m(model.predict(found, held), held),
    }


def error_m(predicted: np.ndarray, windows: Windows) -> float:
    """Root mean square distance, in m, at the end of windows."""
    miss = np.nan_to_num(wrapped(predicted[:, -1] - windows.measured[:, -1])[:, :3], nan=DIVERGED)
    return float(np.sqrt((miss**2).sum(axis=1).mean()))
