"""Writes DataFlash logs for tests: what a vehicle would write of a motion that the test makes up."""

import struct

import numpy as np

from auv_torchrl.flightlog import FlightLog

FORMS = {  # type number, format and columns
    "PARM": (10, "QNf", "TimeUS,Name,Value"),
    "MODE": (11, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": (12, "QB", "TimeUS,Id"),
    "RCOU": (13, "QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{i}" for i in range(1, 15))),
    "ATT": (14, "QccC", "TimeUS,Roll,Pitch,Yaw"),
    "XKF1": (15, "QBffffffccc", "TimeUS,C,VN,VE,VD,PN,PE,PD,GX,GY,GZ"),
    "XKF2": (22, "QBccc", "TimeUS,C,AX,AY,AZ"),
    "XKF4": (16, "QBIB", "TimeUS,C,SS,PI"),
    "BARO": (17, "QBf", "TimeUS,I,Alt"),
    "CTUN": (18, "Qf", "TimeUS,BAlt"),
    "MSG": (19, "QZ", "TimeUS,Message"),
    "IMU": (20, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "VISO": (21, "Qffff", "TimeUS,dt,PosDX,PosDY,PosDZ"),
}
_CODES = {"Q": "Q", "N": "16s", "f": "f", "M": "B", "B": "B", "H": "H", "c": "h", "C": "H", "I": "I", "Z": "64s"}
ALL = {  # a Heavy with everything plugged in as the frame has it
    "FRAME_CONFIG": 2, "MOT_PWM_MIN": 1100, "MOT_PWM_MAX": 1900,
    **{f"SERVO{n}_FUNCTION": 32 + n for n in range(1, 9)},
    **{f"MOT_{n}_DIRECTION": 1 for n in range(1, 9)},
}  # fmt: skip


def described(*names: str) -> bytes:
    """FMT records of these types."""
    made = b""
    for name in names:
        kind, spelt, columns = FORMS[name]
        size = 3 + struct.calcsize("<" + "".join(_CODES[c] for c in spelt))
        made += struct.pack(
            "<3B2B4s16s64s", 0xA3, 0x95, 128, kind, size, name.encode(), spelt.encode(), columns.encode()
        )
    return made


def record(name: str, t: float, *values) -> bytes:
    """One record at ``t`` s; centidegrees are given in degrees."""
    kind, spelt, _ = FORMS[name]
    put = [round(v * 100) if c in "cC" else v for c, v in zip(spelt[1:], values, strict=True)]
    put = [v.encode() if isinstance(v, str) else v for v in put]
    return struct.pack("<3B" + "".join(_CODES[c] for c in spelt), 0xA3, 0x95, kind, round(t * 1e6), *put)


def parameters(values: dict[str, float], t: float = 0.0) -> bytes:
    """The parameters of a vehicle."""
    return b"".join(record("PARM", t, name, float(value)) for name, value in values.items())


def dive(seconds=20.0, begin=5.0, given=ALL, armed: bool | None = True, also=None) -> bytes:
    """A Heavy of ArduSub that turns slowly and sinks, motor 3 on at 1700 us from the middle on.

    ``given`` are its parameters; without ``armed`` it tells that it was disarmed at once, with None nothing; ``also``
    are further records by the time before which they are written.
    """
    made = described(*FORMS) + record("MSG", begin, "ArduSub V4.5.0") + parameters(given, begin)
    made += record("MODE", begin, 19, 19, 1)
    made += b"" if armed is None else record("EV", begin, 10 if armed else 11)
    for k in range(round(seconds * 10)):
        t = begin + k / 10
        made += (also or {}).get(t, b"")
        pulses = [1500] * 8 + [0] * 6
        pulses[2] = 1700 if k > seconds * 5 else 1500
        made += record("RCOU", t, *pulses)
        made += record("ATT", t, 1.0, -2.0, (350 + k / 2) % 360)
        made += record("BARO", t, 0, 30.0 + k % 3) + record("BARO", t, 1, -1.0 - k / 100)
        made += record("CTUN", t, -1.0 - k / 100)
        made += record("XKF4", t, 0, 0b11111, 0)
        made += record("XKF1", t, 0, 0, 0, 0.1, 0.01 * k, -0.02 * k, 1.0 + k / 100, 1.0, 0.0, -1.0)
        made += record("IMU", t, 0, 0.01, 0.02, 0.05, 0.0, 0.0, -9.8)
    return made + (record("EV", begin + seconds, 11) if armed else b"")


def flown(log: FlightLog, given=ALL, begin: float = 5.0) -> bytes:
    """What ArduSub would write of a flight: its first episode at 10 Hz, the estimates of its filter exact.

    ``given`` are the parameters; an output is turned where its MOT_n_DIRECTION says so.
    """
    episode = log.episodes[0]
    t, pose, commands = (values[::2] for values in (episode.t, episode.pose, episode.commands))
    north_east_down = pose[:, :3]
    speeds = np.gradient(north_east_down, t, axis=0)
    turned = [given.get(f"MOT_{n + 1}_DIRECTION", 1) for n in range(commands.shape[1])]
    pulses = np.rint(1500 + 400 * commands * turned).astype(int)
    made = described(*FORMS) + record("MSG", begin, "ArduSub V4.5.0") + parameters(given, begin)
    made += record("MODE", begin, 19, 19, 1) + record("EV", begin, 10)
    for k, time in enumerate(begin + t - t[0]):
        roll, pitch, yaw = np.degrees(pose[k, 3:6])
        made += record("RCOU", time, *pulses[k].tolist(), *[0] * (14 - pulses.shape[1]))
        made += record("ATT", time, roll, pitch, yaw % 360)
        made += record("BARO", time, 0, 30.0) + record("BARO", time, 1, -pose[k, 2])
        made += record("CTUN", time, -pose[k, 2])
        made += record("XKF4", time, 0, 0b11111, 0)
        made += record("XKF1", time, 0, *speeds[k], *north_east_down[k], 0.0, 0.0, 0.0)
    return made + record("EV", begin + t[-1] - t[0], 11)
