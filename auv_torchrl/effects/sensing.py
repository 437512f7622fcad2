"""Effects of the sensors that report pose and velocity."""

import math

from auv_torchrl.effects import advice
from auv_torchrl.effects.effect import Effect, Origin, Parameter, adds, own, sets
from auv_torchrl.effects.trial import DELAYS, TIMES, TURNED_TIMES, Scan, Trial

_FELT = ("ax", "ay", "az")  # channels of the accelerometer


heading_bias = Effect(
    name="heading_bias",
    origin=Origin.SENSING,
    meaning="measured yaw minus true yaw",
    source="compass deviation near iron, or a mocap frame turned against the body",
    parameters=(Parameter("angle", "rad", 0.0, -math.pi, math.pi, "the compass is off by {signed}"),),
    change=adds(angle="heading_bias"),
    advice=advice.heading_bias,
    trial=Trial(
        scans={"angle": Scan((-2.4, -1.6, -0.8, -0.3, -0.05, 0.05, 0.3, 0.8, 1.6, 2.4, 3.1))},
    ),
)


compass_interference = Effect(
    name="compass_interference",
    origin=Origin.SENSING,
    meaning="measured yaw minus true yaw grows with the sum of all thrusts; the angle is that at full thrust of all",
    source="field of the currents to the thrusters beside that of the earth, as ArduPilot's compass-motor calibration",
    parameters=(
        Parameter("angle", "rad", own("compass_per_load"), -1.5, 1.5, "the compass turns by {signed} at full thrust"),
    ),
    change=sets(angle="compass_per_load"),
    advice=advice.compass_interference,
    trial=Trial(
        odds=1e-2,  # what thrusters do to the heading itself is likelier
        unfiltered=("yaw",),  # a filter with a gyro follows its compass within a minute
        scans={"angle": Scan((0.3,), linear=True)},
    ),
)


pose_delay = Effect(
    name="pose_delay",
    origin=Origin.SENSING,
    meaning="the pose is reported late",
    source="motion-capture and acoustic positioning latency",
    parameters=(Parameter("delay", "s", own("pose_delay"), 0.0, 0.8, "the pose is reported {quantity} late"),),
    change=sets(delay="pose_delay"),
    advice=advice.always("look at the delay of the positioning system, and tell the estimator of it"),
    trial=Trial(
        scans={"delay": Scan(DELAYS)},
    ),
)


position_scale = Effect(
    name="position_scale",
    origin=Origin.SENSING,
    meaning="reported positions are the true ones times a factor",
    source="a speed of sound, baseline or camera calibration that is off; feet for metres",
    parameters=(
        Parameter(
            "factor",
            "1",
            own("position_scale"),
            0.2,
            5.0,
            "positions are reported {value:.2f} times as large",
            loose=0.02,  # filters cut quick motions short: ArduSub's to 98 % of what accelerometer and speeds say
            beside=_FELT,
        ),
    ),
    change=sets(factor="position_scale"),
    advice=advice.always(
        "look at the unit of positions, and at the calibration and speed of sound of the positioning system"
    ),
    trial=Trial(
        odds=1e-3,  # a positioning system is calibrated as a whole; thrusters wear one by one
        scans={"factor": Scan(TIMES)},
    ),
)


depth_scale = Effect(
    name="depth_scale",
    origin=Origin.SENSING,
    meaning="reported depths are the true ones times a factor; -1 is z up",
    source="a water density or pressure gain that is off",
    parameters=(
        Parameter(
            "factor",
            "1",
            own("depth_scale"),
            -5.0,
            5.0,
            "depths are reported {value:.2f} times as large",
            guessed=0.03,  # fresh water is 2.5 % lighter than the sea that an autopilot assumes
        ),
    ),
    change=sets(factor="depth_scale"),
    advice=advice.always("look at unit and sign of the depth, and at the water density that the sensor assumes"),
    trial=Trial(
        # A pressure sensor keeps its scale within 1 %, water its density within 3 %; vertical thrusters do not.
        odds=1e-6,
        scans={"factor": Scan(TURNED_TIMES)},
    ),
)


depth_bias = Effect(
    name="depth_bias",
    origin=Origin.SENSING,
    meaning="reported depth minus true depth",
    source="a pressure sensor that was not zeroed at the surface",
    parameters=(Parameter("offset", "m", own("depth_bias"), -20.0, 20.0, "the depth reading is off by {signed}"),),
    change=sets(offset="depth_bias"),
    advice=advice.depth_bias,
    trial=Trial(
        scans={"offset": Scan((1.0,), linear=True)},
    ),
)


velocity_scale = Effect(
    name="velocity_scale",
    origin=Origin.SENSING,
    meaning="reported linear velocities are the true ones times a factor",
    source="a speed of sound or beam angle that is off; knots for metres per second",
    parameters=(
        Parameter(
            "factor", "1", own("velocity_scale"), -5.0, 5.0, "velocities are reported {value:.2f} times as large"
        ),
    ),
    change=sets(factor="velocity_scale"),
    advice=advice.always("look at the unit of speeds, and at the speed of sound that the Doppler log assumes"),
    trial=Trial(
        odds=1e-3,  # likewise
        scans={"factor": Scan(TURNED_TIMES)},
    ),
)


gyro_bias = Effect(
    name="gyro_bias",
    origin=Origin.SENSING,
    meaning="reported angular rates minus true ones",
    source="zero-rate offset of a MEMS gyro, up to 5 deg/s as sold, where nothing estimates it",
    parameters=(
        Parameter(
            "bias",
            "rad/s",
            0.0,
            -0.2,
            0.2,
            "the gyro reads {signed} too much in {which}",
            tuple("pqr"),
            ordinary=0.005,  # what a filter knows the bias to: 0.3 degree/s
        ),
    ),
    change=adds(bias="gyro_bias"),
    advice=advice.always("calibrate the gyro with the vehicle at rest, and let it warm up before the dive"),
    trial=Trial(
        scans={"bias": Scan((0.01,), linear=True)},
    ),
)


accelerometer_bias = Effect(
    name="accelerometer_bias",
    origin=Origin.SENSING,
    meaning="reported specific force minus the true one",
    source="zero-g offset of a MEMS accelerometer, 0.5 m/s^2 and more as sold, where nothing calibrates it; a tilt of "
    "its mounting is one too, 0.17 m/s^2 for each degree",
    parameters=(
        Parameter(
            "bias",
            "m/s^2",
            0.0,
            -3.0,
            3.0,
            "the accelerometer reads {signed} too much in {which}",
            _FELT,
            loose=0.05,  # what a calibration leaves: half a hundredth of the weight, or 0.3 degree of mounting
        ),
    ),
    change=adds(bias="accelerometer_bias"),
    advice=advice.always("calibrate the accelerometer level and on all six sides, and look at how it is mounted"),
    trial=Trial(
        scans={"bias": Scan((0.1,), linear=True)},
        shown_by=_FELT,
    ),
)


sensor_noise = Effect(
    name="sensor_noise",
    origin=Origin.SENSING,
    meaning="white noise on the reported pose, standard deviation per axis",
    source="Lu et al. 2023, section 6, future work",
    parameters=(
        Parameter("position", "m", own("position_noise"), 0.0, 0.5, "positions scatter by {quantity}"),
        Parameter("attitude", "rad", own("attitude_noise"), 0.0, 0.5, "angles scatter by {quantity}"),
    ),
    change=sets(position="position_noise", attitude="attitude_noise"),
    trial=Trial(
        is_noise=True,
    ),
)

EFFECTS = (
    heading_bias, compass_interference, pose_delay, position_scale, depth_scale, depth_bias, velocity_scale, gyro_bias,
    accelerometer_bias, sensor_noise,
)  # fmt: skip
