"""Vehicles as training has them: fields as torch's tensors, and a batch of vehicles in a TensorDict."""

import torch
from tensordict import TensorDict, TensorDictBase

from auv_torchrl.vehicle import Array, Vehicle
from auv_torchrl.vehicle.fields import VEHICLE_FIELDS


def tensors(vehicle: Vehicle, dtype: torch.dtype = torch.float64, device: torch.device | str | None = None) -> Vehicle:
    """The vehicle on torch; tensors of this precision and device stay what they are, arrays are copied."""

    def tensor(field: Array) -> torch.Tensor:
        if isinstance(field, torch.Tensor):
            return field.to(device, dtype)
        return torch.tensor(field, dtype=dtype, device=device)

    return vehicle.map(tensor)


def tensordict_of(vehicle: Vehicle) -> TensorDict:
    """A batch of vehicles as an entry of a TensorDict, its parameters by name."""
    return TensorDict(dict(tensors(vehicle).items()), vehicle.batch_size)


def vehicle_of(entry: TensorDictBase) -> Vehicle:
    """The vehicles of such an entry, on torch."""
    return Vehicle(**{name: entry.get(name) for name in VEHICLE_FIELDS})
