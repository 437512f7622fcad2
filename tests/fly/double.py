"""A stand-in for ArduSub over MAVLink that flies our own simulator; pymavlink is its end of the conversation.

It does what shared facts say of ArduSub: obeys one ground station, mixes its six inputs in mode MANUAL alone, disarms
3 s after the last input, and says what it is asked. Time is a number that a test or a thread moves.
"""

import math
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from auv_torchrl.autopilot import FRAMES
from auv_torchrl.fly.known import MANUAL
from auv_torchrl.link.plant import Plant, Start, to_earth
from auv_torchrl.physics.kinematics import euler_angles
from auv_torchrl.scenario import Scenario
from auv_torchrl.vehicle import load_vehicle

STEP_S = 0.04
STABILIZE = 0
PARAMETERS = {
    "FRAME_CONFIG": 2.0, "ACRO_YAW_P": 3.375, "JS_THR_GAIN": 1.0, "JS_GAIN_DEFAULT": 0.5, "FS_PILOT_INPUT": 2.0,
    "MAV_GCS_SYSID": 255.0,
    **{f"RC{n}_{name}": value for n in range(1, 7)
       for name, value in (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0), ("REVERSED", 0.0))},
}  # fmt: skip
FAILSAFE_S = 3.0  # of FS_PILOT_INPUT


@dataclass
class Vehicle:
    """One ArduSub.

    Args:
        start: where it is.
        parameters: instead of the usual ones.
    """

    start: Start = field(default_factory=lambda: Start(down=2.0, north=3.0, yaw=0.7))
    parameters: dict = field(default_factory=dict)
    scenario: Scenario = field(default_factory=lambda: Scenario("nominal"))
    kind: int = mavlink.MAV_TYPE_SUBMARINE
    version: tuple = (4, 5)
    gain: float = 0.5
    refuses_to_arm: bool = False
    says_heartbeat: bool = True
    says_position: bool = True
    lie: Any = None  # makes another position of a true one
    hook: Any = None  # is called at each step

    def __post_init__(self):
        self.parameters = {**PARAMETERS, **self.parameters}
        self.plant = Plant(load_vehicle("bluerov2_heavy"), self.scenario, self.start)
        self.time_s, self.mode, self.armed = 100.0, STABILIZE, False
        self.inputs = {n: 1500 for n in range(1, 7)}
        self.command = np.zeros(8)
        self.commands = []  # time and inputs as they came while it was armed
        self.others = []  # names of other messages that came
        self._input_s = -math.inf
        self._mav = mavlink.MAVLink(BytesIO(), srcSystem=1, srcComponent=1)
        self._parser = mavlink.MAVLink(BytesIO())
        self._parser.robust_parsing = True
        self._out = []
        self._named_s = self._beat_s = -math.inf

    def step(self):
        """Go on by a step; the bytes that are sent meanwhile."""
        self.time_s += STEP_S
        if self.hook is not None:
            self.hook(self)
        if self.armed and self.time_s - self._input_s > FAILSAFE_S:
            self.armed = False
        self.command = self._mixed() if self.armed and self.mode == MANUAL else np.zeros(8)
        self.plant.step(self.command.tolist(), STEP_S)
        self._tell()
        out, self._out = b"".join(self._out), []
        return out

    def hear(self, data):
        """Take what a ground station sends."""
        for message in self._parser.parse_buffer(data) or ():
            is_pilot = message.get_srcSystem() == self.parameters.get("MAV_GCS_SYSID", 255)
            if is_pilot or message.get_type() not in ("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"):
                self._obey(message)

    @property
    def place(self):
        """Where it is, m."""
        return self.plant.moment.state[0][0]

    def _mixed(self):
        """Outputs of the mixer, shares of full travel."""
        share = {n: (pulse - 1500) / 400 for n, pulse in self.inputs.items()}
        axes = np.array([share[5], share[6], -share[3], share[4] * self.parameters["ACRO_YAW_P"] / 3.375])
        return np.clip(np.array(FRAMES[int(self.parameters["FRAME_CONFIG"])][1]) @ axes, -1, 1)

    def _obey(self, message):
        name = message.get_type()
        if name == "RC_CHANNELS_OVERRIDE":
            self._input({n: getattr(message, f"chan{n}_raw") for n in range(1, 7)})
        elif name == "MANUAL_CONTROL":
            assert message.buttons == 0 and message.s == 0 and message.t == 0
            scale, centre = 0.4 * self.gain, 1500
            lift = 0.8 * self.gain * self.parameters["JS_THR_GAIN"]
            self._input({
                1: centre, 2: centre, 3: int(centre + lift * (message.z - 500)), 4: int(centre + scale * message.r),
                5: int(centre + scale * message.x), 6: int(centre + scale * message.y),
            })  # fmt: skip
        else:
            self.others.append(name)
        if name == "SET_MODE":
            self.mode = message.custom_mode
        elif name == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            told = self.parameters[message.param_id]
            self._send(mavlink.MAVLink_param_value_message(message.param_id.encode(), told, 9, 1, 0))
        elif name == "COMMAND_LONG":
            self._execute(message)

    def _input(self, pulses):
        assert all(1100 <= pulse <= 1900 for pulse in pulses.values())
        self.inputs, self._input_s = pulses, self.time_s
        self.commands.append((self.time_s, dict(pulses)))

    def _execute(self, message):
        result = 0
        if message.command == 400:
            result = 4 if self.refuses_to_arm and message.param1 else 0
            if result:
                self._send(mavlink.MAVLink_statustext_message(4, b"PreArm: leak detected"))
            else:
                self.armed = bool(message.param1)
        if message.command == 512 and message.param1 == 148:
            number = self.version[0] << 24 | self.version[1] << 16
            self._send(
                mavlink.MAVLink_autopilot_version_message(0, number, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0)
            )
        self._send(mavlink.MAVLink_command_ack_message(message.command, result))

    def _tell(self):
        boot = round(self.time_s * 1000)
        if self.says_heartbeat and self.time_s - self._beat_s >= 0.99:
            self._beat_s = self.time_s
            base = 128 * self.armed + 81
            self._send(mavlink.MAVLink_heartbeat_message(self.kind, 3, base, self.mode, 4, 3))
            self._send(mavlink.MAVLink_named_value_float_message(boot, b"PilotGain", self.gain))
        position, quaternion, velocity = (part[0] for part in self.plant.moment.reported)
        roll, pitch, yaw = (float(angle) for angle in euler_angles(quaternion))
        self._send(mavlink.MAVLink_attitude_message(boot, roll, pitch, yaw, *velocity[3:].tolist()))
        if self.says_position:
            told = position.tolist() if self.lie is None else self.lie(position.tolist())
            vn, ve, vd = to_earth(quaternion.tolist(), velocity[:3].tolist())
            self._send(mavlink.MAVLink_local_position_ned_message(boot, told[0], told[1], told[2], vn, ve, vd))

    def _send(self, message):
        self._out.append(message.pack(self._mav))


class VirtualLink:
    """A connection whose clock is that of the vehicle: a flight of a minute takes a second, and is always the same."""

    def __init__(self, vehicle):
        self.vehicle, self.lost, self.full, self.sent = vehicle, False, False, b""
        self._now = 0.0
        self._at = 0.0  # until when the vehicle has flown

    def now(self):
        return self._now

    def receive(self, until_s):
        if self._at + STEP_S > until_s:
            self._now = max(self._now, until_s)
            return b""
        self._at += STEP_S
        self._now = max(self._now, self._at)
        return self.vehicle.step()

    def send(self, data):
        self.sent += data
        self.vehicle.hear(data)

    def blocked(self):
        return self.full
