"""Domain randomization: every vehicle draws its effects anew at each of its resets."""

from collections.abc import Mapping
from typing import Any, cast

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs.transforms import Transform

from auv_torchrl.array_api import host
from auv_torchrl.effects import Effect, get_effect
from auv_torchrl.envs.start import VEHICLE
from auv_torchrl.quantities import counted
from auv_torchrl.vehicle import Vehicle
from auv_torchrl.vehicle.tensors import tensordict_of, tensors

TOGETHER = "together"  # of ranges: rows of a lower triangle, by which their first numbers are drawn together
Ranges = list[tuple[Effect, dict[str, tuple[float, float]]]]


class RandomizeVehicle(Transform):
    """Hands the fleet freshly drawn vehicles for the rows that are reset.

    The fleet's ``reset_spec`` declares the entry by which they go. Every draw starts from the nominal vehicle, so that
    repeated resets never accumulate. Values are uniform and independent, per member where a family is given; where
    ``ranges`` have ``together``, the first ones are mixed by it, so that their correlation is that of its rows, and a
    few lie a little beyond their range. The draws come from the fleet's own random source, so that one seed repeats a
    whole run, unless ``seed`` gives them one of their own.

    Args:
        nominal: one vehicle, empty batch.
        ranges: ``{effect: {parameter or family: [low, high]}}``, as in ``conf/randomization/*.yaml``.
        seed: of the draws; None takes them from the fleet.
        entry: name of an entry that shows what was drawn, each value in [-1, 1] of its range; None shows nothing.

    Raises:
        ValueError: for ranges that :func:`read_ranges` refuses.
    """

    def __init__(
        self, nominal: Vehicle, ranges: Mapping[str, Any] | None, seed: int | None = None, entry: str | None = None
    ) -> None:
        super().__init__(in_keys=[], out_keys=[] if entry is None else [entry])
        self._nominal = nominal.map(host)
        self.ranges = read_ranges(nominal, ranges)
        self._mixed = _read_together(ranges, sum(len(parameters) for _, parameters in self.ranges))
        self._bounds = self._most() if self._mixed is not None else ()
        self._own = None if seed is None else torch.Generator().manual_seed(seed)
        self._vehicles: TensorDict | None = None
        self._shares = torch.zeros(0, 0)  # of what the vehicles were drawn with, in [-1, 1]

    def draw(self, count: int, generator: torch.Generator) -> Vehicle:
        """``count`` vehicles, each drawn from the nominal one, on torch."""
        return self._made(self._values(count, generator)[0])

    def _values(self, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Numbers (count, k) that are drawn, and where they lie in their ranges, in [-1, 1]."""
        members = [limits for _, parameters in self.ranges for limits in parameters.values()]
        low, high = torch.tensor(members, dtype=torch.float64).reshape(-1, 2).unbind(-1)
        share = torch.rand(count, len(members), generator=generator, dtype=torch.float64)
        if self._mixed is None:
            values = low + (high - low) * share
        else:
            first = len(self._mixed)
            share[:, :first] = 0.5 + (share[:, :first] - 0.5) @ self._mixed.T  # correlated about the middle
            values = (low + (high - low) * share).clamp(*self._bounds)
        return values, 2 * share.float() - 1

    def _made(self, values: Tensor) -> Vehicle:
        """The nominal vehicle with other numbers (count, k)."""
        vehicle = self._nominal.expand(len(values))
        columns = iter(values.unbind(-1))
        for effect, parameters in self.ranges:
            vehicle = effect.apply(vehicle, {member: next(columns) for member in parameters})
        return tensors(vehicle)

    def _most(self) -> tuple[Tensor, Tensor]:
        """Least and most (k,) that effects allow."""
        declared = [
            effect.member_parameters(self._nominal)[member]
            for effect, parameters in self.ranges
            for member in parameters
        ]
        low, high = torch.tensor([(p.low, p.high) for p in declared], dtype=torch.float64).unbind(-1)
        return low, high

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        env = self._environment()
        if tensordict is None:
            tensordict = TensorDict({}, env.batch_size, device=env.device)
        (count,) = env.batch_size
        mask = tensordict.get("_reset", None)
        rows = torch.arange(count) if mask is None else mask.reshape(count).cpu().nonzero()[:, 0]
        values, shares = self._values(len(rows), self._own or env.generator)
        drawn = self._made(values)
        if self._vehicles is None or self._vehicles.batch_size[0] != count:
            self._vehicles = tensordict_of(self._nominal.expand(count).clone())
            self._shares = shares.new_zeros(count, shares.shape[-1])
        self._vehicles[rows] = tensordict_of(drawn)
        self._shares[rows] = shares
        return tensordict.set(VEHICLE, self._vehicles)

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        for entry in self.out_keys:
            next_tensordict.set(entry, self._shares.to(next_tensordict.device, copy=True))
        return next_tensordict

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    def transform_observation_spec(self, observation_spec: TensorSpec) -> TensorSpec:
        """Declare what tells of the draws, where it does."""
        spec, count = cast(Composite, observation_spec), sum(len(parameters) for _, parameters in self.ranges)
        for entry in self.out_keys:
            spec[entry] = Unbounded(torch.Size((*spec.shape, count)), dtype=torch.float32, device=spec.device)
        return observation_spec

    def _environment(self) -> Any:
        """The environment below, whose reset takes vehicles; between them are transforms alone.

        Raises:
            RuntimeError: for any other, to which vehicles would be handed in vain.
        """
        env: Any = getattr(self.parent, "base_env", self.parent)
        if VEHICLE not in getattr(env, "__dict__", {}).get("reset_spec", {}):  # its own: no other hands vehicles on
            raise RuntimeError(
                "RandomizeVehicle: what is below it takes no vehicles at a reset: put it in the TransformedEnv of a "
                "FleetEnv; a SerialEnv or ParallelEnv is made of such environments"
            )
        return env


def read_ranges(nominal: Vehicle, ranges: Mapping[str, Any] | None) -> Ranges:
    """Check ``{effect: {parameter or family: [low, high]}}`` against the registry of effects.

    Raises:
        ValueError: for an unknown effect or parameter, no pair of numbers, low above high, a value outside the
            bounds of the effect, or a parameter that is no continuous number.
    """
    checked: Ranges = []
    if not isinstance(ranges, Mapping | None):
        raise ValueError(f"randomization: {ranges!r}: give a mapping of effects to ranges")
    for name, parameters in (ranges or {}).items():
        if name == TOGETHER:
            continue
        effect = get_effect(name)
        if not isinstance(parameters, Mapping):
            raise ValueError(f"randomization: {name} is {parameters!r}: give a mapping of parameters to [low, high]")
        members: dict[str, tuple[float, float]] = {}
        for key, limits in parameters.items():
            if isinstance(limits, str | Mapping) or not hasattr(limits, "__len__") or len(limits) != 2:
                raise ValueError(f"randomization: {name}.{key} is {limits!r}: give [low, high]")
            low, high = (effect.read(nominal, {key: limit}) for limit in limits)
            for member in low:
                if effect.member_parameters(nominal)[member].discrete:
                    raise ValueError(f"randomization: {name}.{key} counts, it has no range: use a scenario for it")
                if low[member] > high[member]:
                    raise ValueError(f"randomization: {name}.{key} is {list(limits)}: low is above high")
                members[member] = (low[member], high[member])
        checked.append((effect, members))
    return checked


def _read_together(ranges: Mapping[str, Any] | None, count: int) -> Tensor | None:
    """Lower triangle (m, m) of the first ``m`` of ``count`` numbers; None where all are drawn on their own."""
    rows = (ranges or {}).get(TOGETHER)
    if rows is None:
        return None
    if not isinstance(rows, list | tuple) or not len(rows) <= count:
        raise ValueError(
            f"randomization: {TOGETHER}: give a row for each of the {counted(count, 'number')}, or for the first ones"
        )
    triangle = torch.zeros(len(rows), len(rows), dtype=torch.float64)
    for i, row in enumerate(rows):
        if not isinstance(row, list | tuple) or len(row) != i + 1 or not all(isinstance(v, int | float) for v in row):
            raise ValueError(f"randomization: {TOGETHER}: row {i + 1} is not {counted(i + 1, 'number')}")
        triangle[i, : i + 1] = torch.tensor(row, dtype=torch.float64)
    if not triangle.isfinite().all():
        raise ValueError(f"randomization: {TOGETHER}: give finite numbers")
    return triangle
