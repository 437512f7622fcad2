"""Effects of where and how sensors are mounted on the body."""

import math

from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Effect, Origin, Parameter, adds
from auv_torchrl.effects.trial import Scan, Trial
from auv_torchrl.vehicle import Vehicle

dvl_misalignment = Effect(
    name="dvl_misalignment",
    origin=Origin.SENSING,
    meaning="how far the Doppler log is turned about the body z axis from how the vehicle's file has it",
    source="Kinsey and Whitcomb 2007, in-situ alignment of Doppler sensors; a bracket bolted on a quarter turn off",
    parameters=(
        Parameter(
            "angle",
            "rad",
            0.0,
            -math.pi,
            math.pi,
            "the Doppler log is turned by {signed}",
            ordinary=0.02,  # 1 degree, to which brackets are straight
            guessed=0.02,
        ),
    ),
    change=adds(angle="dvl_turn"),
    advice=advice.dvl_misalignment,
    trial=Trial(
        odds=1e-2,  # it is bolted on once; thrusters wear
        scans={"angle": Scan((-2.4, -1.57, -0.8, -0.3, -0.05, 0.05, 0.3, 0.8, 1.57, 2.4, 3.14))},
    ),
)


def _guessed_arm(vehicle: Vehicle, member: str) -> float:
    """As measured with a rule where the file says where it sits; half a small vehicle where it does not."""
    return 0.01 if bool((vehicle.dvl_position != 0).any()) else 0.2


dvl_lever_arm = Effect(
    name="dvl_lever_arm",
    origin=Origin.SENSING,
    meaning="from where the vehicle's file has the Doppler log to where it sits: it feels how the body turns",
    source="Fossen 2021, section 2.4; Kinsey and Whitcomb 2007",
    parameters=(
        Parameter(
            "arm",
            "m",
            0.0,
            -3.0,
            3.0,
            "the Doppler log sits {signed} along {which} from where the file has it",
            tuple("xyz"),
            ordinary=0.01,  # of a place measured with a rule
            guessed=_guessed_arm,
        ),
    ),
    change=adds(arm="dvl_position"),
    advice=advice.dvl_lever_arm,
    is_property=True,
    trial=Trial(
        odds=1e-2,  # likewise
        scans={"arm": Scan((0.2,), linear=True)},
    ),
)

EFFECTS = (dvl_misalignment, dvl_lever_arm)
