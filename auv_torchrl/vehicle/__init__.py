"""A vehicle: its parameters in one table, files of them, and a batch of vehicles as arrays or tensors.

Read :mod:`~auv_torchrl.vehicle.fields` first, then :mod:`~auv_torchrl.vehicle.vehicle`.
"""

from typing import TYPE_CHECKING

from auv_torchrl.late import late

if TYPE_CHECKING:
    from auv_torchrl.vehicle.fields import CONTROLLED, DEGREES_OF_FREEDOM
    from auv_torchrl.vehicle.vehicle import (
        CONTROLLED_INDEX,
        Array,
        Vehicle,
        index_of,
        load_vehicle,
        read_vehicle_file,
        stacked,
        vehicle_doubts,
        without_entry,
    )

__all__ = [
    "CONTROLLED",
    "CONTROLLED_INDEX",
    "DEGREES_OF_FREEDOM",
    "Array",
    "Vehicle",
    "index_of",
    "load_vehicle",
    "read_vehicle_file",
    "stacked",
    "vehicle_doubts",
    "without_entry",
]

__getattr__ = late(
    __name__,
    {
        "fields": "CONTROLLED DEGREES_OF_FREEDOM",
        "vehicle": "CONTROLLED_INDEX Array Vehicle index_of load_vehicle read_vehicle_file stacked vehicle_doubts "
        "without_entry",
    },
)
