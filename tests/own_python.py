"""An effect, a task, a sensor and a reader of one's own, as their files."""

FOULING = """
from auv_torchrl.effects.effect import Effect, Origin, Parameter, changed
from auv_torchrl.effects.trial import Trial


def _fouling(vehicle, factor):
    return changed(
        vehicle,
        linear_drag=factor[..., None, None] * vehicle.linear_drag,
        quadratic_drag=factor[..., None] * vehicle.quadratic_drag,
    )


fouling = Effect(
    name="fouling",
    origin=Origin.FLOW,
    meaning="all drag times one factor: growth on the hull",
    source="Schultz 2007, resistance of fouled hulls",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 5.0, "drag is {value:.2f} times the nominal one"),),
    change=_fouling,
)

EFFECTS = (fouling,)
"""

BELOW = """
from dataclasses import dataclass

import torch

from auv_torchrl.tasks import StationKeeping


@dataclass(frozen=True)
class Below(StationKeeping):
    name = "below"
    depth_m: float = 2.0

    def reference(self, time):
        origin = super().reference(time)
        down = torch.tensor([0.0, 0.0, self.depth_m])
        below = origin.position + (down if torch.is_tensor(time) else down.numpy())
        return origin._replace(position=below)


TASKS = (Below,)
"""

BOW_GAUGE = """
from array_api_compat import array_namespace

from auv_torchrl.sensors import Sensor

AHEAD = 0.4  # m


def _depth(c, motion):
    xp = array_namespace(motion)
    return motion[..., 2:3] - AHEAD * xp.sin(motion[..., 4:5])


SENSORS = (Sensor("bow_gauge", ("z",), "a pressure gauge at the bow", _depth, lambda c: 0.0 * c.pose_delay),)
"""

SEMICOLONS = """
import numpy as np

from auv_torchrl.flightlog.readers import Reader
from auv_torchrl.flightlog.streams.stream import Sampling, Streams, stream


def _read(path, options):
    _, names, *rows = path.read_text().splitlines()
    columns = dict(zip(names.split(";"), np.array([row.split(";") for row in rows], dtype=float).T, strict=True))

    def picked(name, channels, unit, sampling):
        values = np.stack([columns[channel] for channel in channels], axis=-1)
        return stream(name, channels, unit, columns["t"], values, sampling, "columns")

    commands = [name for name in columns if name.startswith("cmd_")]
    return Streams(path.name, "semicolons", {
        "commands": picked("commands", commands, "1", Sampling.HELD),
        "position": picked("position", ("x", "y", "z"), "m", Sampling.MEASURED),
        "attitude": picked("attitude", ("yaw",), "rad", Sampling.MEASURED),
    })


READERS = (Reader("semicolons", (".semi",), lambda head: head.startswith(b"SEMI"), _read),)
"""
