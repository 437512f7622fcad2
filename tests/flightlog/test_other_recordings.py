"""PX4 logs, ROS bags and MCAP: written here by their own libraries, or byte by byte, of a motion that is known."""

import json
import struct
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from auv_torchrl.flightlog import FlightLogError
from auv_torchrl.flightlog.streams import tabulate
from auv_torchrl.flightlog.streams.motors import commands_of
from auv_torchrl.flightlog.streams.stream import ReadOptions
from tests.flightlog.dataflash_writer import ALL
from tests.flightlog.shared_data import EXCERPTS, shared
from tests.flightlog.vehicle_log import streams_of

LEVEL_NORTH_ENU = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # w x y z of a body that looks north: 90 degrees from east


def ulog_file() -> bytes:
    """A PX4 log: armed after 1 s, motor 2 at 0.5, motor 3 not there, rolled by 0.2 rad."""

    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    topics = {
        "actuator_motors": "uint64_t timestamp;float[12] control;",
        "vehicle_attitude": "uint64_t timestamp;float[4] q;",
        "vehicle_status": "uint64_t timestamp;uint8_t arming_state;uint8_t nav_state;",
        "vehicle_local_position": "uint64_t timestamp;float x;float y;float z;float vx;float vy;float vz;bool xy_valid;"
        "bool z_valid;bool v_xy_valid;bool v_z_valid;",
    }
    data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000) + message("B", bytes(40))
    for name, fields in topics.items():
        data += message("F", f"{name}:{fields}".encode())
    key = b"float CA_ROTOR_COUNT"
    data += message("P", bytes([len(key)]) + key + struct.pack("<f", 2.0))
    for number, name in enumerate(topics):
        data += message("A", struct.pack("<BH", 0, number) + name.encode())
    roll = (np.cos(0.1), np.sin(0.1), 0.0, 0.0)
    for k in range(200):
        stamp = struct.pack("<Q", 1_000_000 + k * 50_000)
        motors = struct.pack("<12f", 0.0, 0.5, *[np.nan] * 10)
        data += message("D", struct.pack("<H", 0) + stamp + motors)
        data += message("D", struct.pack("<H", 1) + stamp + struct.pack("<4f", *roll))
        data += message("D", struct.pack("<H", 2) + stamp + struct.pack("<2B", 2 if k >= 20 else 1, 0))
        data += message("D", struct.pack("<H", 3) + stamp + struct.pack("<6f4B", k, 0, 1, 0, 0, 0, 0, 1, 0, 1))
    return data


def test_a_px4_log_is_read(tmp_path):
    """Commands as they are, attitude from the quaternion, no position where the filter has none, armed from 1 s on."""
    path = tmp_path / "flight.ulg"
    path.write_bytes(ulog_file())
    streams = streams_of(path)
    assert streams.armed == ((pytest.approx(1.0), pytest.approx(9.95)),) and streams.modes == ((0.0, "MANUAL"),)
    columns = tabulate(streams).columns
    assert set(columns) == {"t", "episode", "z", "roll", "pitch", "yaw", "cmd_1", "cmd_2"}
    assert columns["cmd_2"] == pytest.approx(0.5) and columns["roll"] == pytest.approx(0.2, abs=1e-6)


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_of_a_px4_log_ends_in_a_traceback(tmp_path, data):
    """Cut anywhere, bytes changed anywhere behind the head."""
    content = bytearray(ulog_file())
    end = data.draw(st.integers(16, len(content)))
    for place in data.draw(st.lists(st.integers(16, len(content) - 1), max_size=20)):
        content[place] = data.draw(st.integers(0, 255))
    path = tmp_path / "flight.ulg"
    path.write_bytes(bytes(content[:end]))
    try:
        tabulate(streams_of(path))
    except FlightLogError as error:
        assert "\n" not in str(error)


@contextmanager
def recording(path):
    """What puts a text under a topic of an MCAP file, received and sent at times in ns."""
    writer = pytest.importorskip("mcap.writer")
    channels = {}
    with path.open("wb") as file:
        out = writer.Writer(file)
        out.start()

        def record(topic, text, received, sent):
            if topic not in channels:
                schema = out.register_schema(topic.replace("/", "."), "jsonschema", b"{}")
                channels[topic] = out.register_channel(topic, "json", schema)
            out.add_message(channels[topic], received, text.encode(), sent)

        yield record
        out.finish()


def mcap_file(path, topics=("mavlink/{system}/1/{name}",), servos=16, zero="\0", systems=(1,), given=ALL):
    """MAVLink as BlueOS records it: JSON by topic, enumerations by name; ``given`` are parameters that it heard."""
    with recording(path) as record:

        def put(t, name, **fields):
            for system in systems:
                body = {"header": {"system_id": system, "component_id": 1}, "message": {"type": name, **fields}}
                text = json.dumps(body).replace("\\u0000", zero)
                for form in topics:
                    record(form.format(system=system, name=name), text, round((1.7e9 + t) * 1e9), round(t * 1e9))

        put(0, "STATUSTEXT", text=[*"ArduSub V4.5.0", "\0", "x"], severity={"type": "MAV_SEVERITY_INFO"})
        for name, value in given.items():
            put(0, "PARAM_VALUE", param_id=[*name, "\0"], param_value=float(value), param_count=1, param_index=0)
        for k in range(100):
            t = k / 10
            if k % 10 == 0:
                beat = {"mavtype": {"type": "MAV_TYPE_SUBMARINE"}, "autopilot": {"type": "MAV_AUTOPILOT_ARDUPILOTMEGA"}}
                put(t, "HEARTBEAT", base_mode={"bits": 209 if k else 81}, custom_mode=19, **beat)
                put(t, "EKF_STATUS_REPORT", flags="EKF_ATTITUDE | EKF_POS_HORIZ_REL | EKF_VELOCITY_HORIZ")
            servo = {f"servo{n}_raw": 1600 if n == 2 else 1500 for n in range(1, servos + 1)}
            put(t, "SERVO_OUTPUT_RAW", time_usec=round((t + 50) * 1e6), port=0, **servo)
            rates = {"rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.5}
            put(t, "ATTITUDE", time_boot_ms=round((t + 50) * 1e3), roll=0.1, pitch=0.0, yaw=0.2, **rates)
            place = {"x": 1.0, "y": 2.0, "z": 3.0, "vx": 0.0, "vy": 0.0, "vz": 0.0}
            put(t, "LOCAL_POSITION_NED", time_boot_ms=round((t + 50) * 1e3), **place)
    return path


def test_mavlink_in_mcap_is_read_as_blueos_writes_it(tmp_path):
    """The same streams as from telemetry."""
    streams = streams_of(mcap_file(tmp_path / "recorder.mcap"))
    assert streams.armed is not None
    assert streams.vehicle.frame == "vectored_6dof" and streams.armed[0][0] == pytest.approx(1.0, abs=0.01)
    columns = tabulate(streams).columns
    assert columns["cmd_2"] == pytest.approx(0.25) and columns["x"] == pytest.approx(1.0)
    assert columns["r"] == pytest.approx(0.5)


def as_blueos(dialect, message) -> dict:
    """A message of pymavlink as the recorder writes it: signs one by one, what is one of several by its name."""
    fields = {}
    for name in message.fieldnames:
        value, enum = getattr(message, name), dialect.enums.get(message.fieldenums_by_name.get(name, ""), {})
        if isinstance(value, str):
            value = [*value, "\0"]
        elif name == "base_mode":
            value = {"bits": value}
        elif message.fielddisplays_by_name.get(name) == "bitmask":
            value = " | ".join(flag.name for bit, flag in enum.items() if bit and value & bit == bit)
        elif value in enum:
            value = {"type": enum[value].name}
        fields["mavtype" if name == "type" else name] = value
    return {"type": message.get_type(), **fields}


def test_what_firmware_sent_is_the_same_log_in_mcap_as_in_telemetry(tmp_path):
    """Fourteen seconds of what ArduSub 4.7 sent, carried as the recorder of BlueOS carries it."""
    mavutil = pytest.importorskip("pymavlink.mavutil")
    dialect = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
    link = mavutil.mavlink_connection(str(EXCERPTS / "ardusub.tlog"), dialect="ardupilotmega")
    with recording(tmp_path / "recorder.mcap") as record:
        while (message := link.recv_msg()) is not None:
            header = {"system_id": message.get_srcSystem(), "component_id": message.get_srcComponent()}
            topic = "mavlink/{system_id}/{component_id}/{name}".format(**header, name=message.get_type())
            received = round(message._timestamp * 1e9)
            record(topic, json.dumps({"header": header, "message": as_blueos(dialect, message)}), received, received)
    carried, sent = streams_of(tmp_path / "recorder.mcap"), streams_of(EXCERPTS / "ardusub.tlog")
    assert carried.armed and sent.armed and carried.armed[0] == pytest.approx(sent.armed[0], abs=1e-5)
    assert [mode[-1] for mode in carried.modes] == [mode[-1] for mode in sent.modes]
    assert carried.vehicle == sent.vehicle and carried.streams.keys() == sent.streams.keys()
    assert {"outputs", "attitude", "depth", "accelerometer"} <= sent.streams.keys()
    for name, stream in sent.streams.items():
        assert carried.streams[name].values == pytest.approx(stream.values, nan_ok=True), name
        assert carried.streams[name].t == pytest.approx(stream.t, abs=2e-6), name  # a receiver writes microseconds


@pytest.mark.parametrize(
    "topics",
    [
        ("mavlink/out",),
        ("mavlink/out", "mavlink/{system}/1/{name}"),
        ("mavlink/{system}/1/{name}", "mavlink/{system}/1/{name}/type", "mavlink/out"),
    ],
)
def test_all_that_the_bus_of_blueos_says_is_read_once(tmp_path, topics):
    """Each message comes under the name of its own, under a common one, or under both; outputs beyond 8 do not come."""
    plain = streams_of(mcap_file(tmp_path / "plain.mcap"))
    streams = streams_of(mcap_file(tmp_path / "recorder.mcap", topics, servos=8))
    assert {name: len(s) for name, s in streams.streams.items()} == {name: len(s) for name, s in plain.streams.items()}
    assert streams.vehicle.parameters == plain.vehicle.parameters and streams.armed == plain.armed
    assert tabulate(streams).columns["cmd_2"] == pytest.approx(0.25)
    assert "damaged_file" not in {finding.code for finding in streams.findings}


@pytest.mark.parametrize("topics", [("mavlink/out",), ("mavlink/{system}/1/{name}",)])
def test_of_several_vehicles_in_an_mcap_one_is_chosen(tmp_path, topics):
    """By number; without one, the numbers are told."""
    path = mcap_file(tmp_path / "recorder.mcap", topics, systems=(1, 2))
    with pytest.raises(FlightLogError, match="has several vehicles, 1, 2: choose one, such as system=1"):
        streams_of(path)
    alone = streams_of(mcap_file(tmp_path / "alone.mcap", topics))
    chosen = streams_of(path, ReadOptions(system=2))
    assert {name: len(s) for name, s in chosen.streams.items()} == {name: len(s) for name, s in alone.streams.items()}


def test_an_mcap_that_was_cut_is_read_as_far_as_it_goes(tmp_path):
    """As after a loss of power: a finding, or a sentence where nothing was written yet."""
    whole = mcap_file(tmp_path / "recorder.mcap").read_bytes()
    path = tmp_path / "cut.mcap"
    for share in (0.99, 0.5, 0.1, 0.01):
        path.write_bytes(whole[: int(share * len(whole))])
        try:
            assert "damaged_file" in {finding.code for finding in streams_of(path).findings}
        except FlightLogError as error:
            assert "cut.mcap" in str(error)


def ros_bag(folder, version: int, storage: str = "sqlite3"):
    """Odometry and an IMU of a body that looks north and goes ahead, and numbers for six thrusters."""
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if version == 1 else typesys.Stores.ROS2_HUMBLE)
    kinds = store.types
    if version == 1:
        from rosbags.rosbag1 import Writer

        out, put = Writer(folder), store.serialize_ros1
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        out, put = Writer(folder, version=9, storage_plugin=plugin), store.serialize_cdr
    vector, turn = kinds["geometry_msgs/msg/Vector3"], kinds["geometry_msgs/msg/Quaternion"]
    w, x, y, z = LEVEL_NORTH_ENU
    with out:
        topics = {
            name: out.add_connection(name, kind, typestore=store)
            for name, kind in (
                ("/odom", "nav_msgs/msg/Odometry"),
                ("/imu", "sensor_msgs/msg/Imu"),
                ("/thrusters", "std_msgs/msg/Float64MultiArray"),
            )
        }
        for k in range(100):
            t = 1.7e9 + k / 10
            stamp = kinds["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round(t % 1 * 1e9))
            head = {"stamp": stamp, "frame_id": "odom"} | ({"seq": k} if version == 1 else {})
            header = kinds["std_msgs/msg/Header"](**head)
            place = kinds["geometry_msgs/msg/Point"](x=1.0, y=k / 10, z=-3.0)  # 1 east, north with 1 m/s, 3 deep
            pose = kinds["geometry_msgs/msg/Pose"](position=place, orientation=turn(x=x, y=y, z=z, w=w))
            twist = kinds["geometry_msgs/msg/Twist"](
                linear=vector(x=1.0, y=0.1, z=0.2), angular=vector(x=0.0, y=0.0, z=0.3)
            )
            none = np.zeros(36)
            odometry = kinds["nav_msgs/msg/Odometry"](
                header=header,
                child_frame_id="base_link",
                pose=kinds["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=none),
                twist=kinds["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=none),
            )
            imu = kinds["sensor_msgs/msg/Imu"](
                header=header,
                orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0),
                orientation_covariance=np.array([-1.0] + [0.0] * 8),
                angular_velocity=vector(x=0.0, y=0.2, z=0.3),
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=vector(x=0.0, y=0.0, z=9.81),
                linear_acceleration_covariance=np.zeros(9),
            )
            layout = kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            sent = kinds["std_msgs/msg/Float64MultiArray"](layout=layout, data=np.linspace(-0.5, 0.5, 6))
            for name, message in (("/odom", odometry), ("/imu", imu), ("/thrusters", sent)):
                kind = topics[name].msgtype
                out.write(topics[name], round(t * 1e9), put(message, kind))
    return folder


@pytest.mark.parametrize(("version", "storage"), [(1, ""), (2, "sqlite3"), (2, "mcap")])
def test_ros_bags_are_read_in_ned_and_frd(tmp_path, version, storage):
    """North, east, down and forward, right, down out of ENU and FLU; rates from the IMU, which has no attitude."""
    path = ros_bag(tmp_path / ("flight.bag" if version == 1 else "flight"), version, storage)
    columns = tabulate(streams_of(path)).columns
    assert columns["x"][10] == pytest.approx(columns["t"][10], abs=1e-3)
    assert columns["y"] == pytest.approx(1.0) and columns["z"] == pytest.approx(3.0)
    for angle in ("roll", "pitch", "yaw"):
        assert columns[angle] == pytest.approx(0.0, abs=1e-9)
    for axis, value in {"u": 1.0, "v": -0.1, "w": -0.2, "q": -0.2, "r": -0.3}.items():
        assert columns[axis] == pytest.approx(value)
    assert columns["cmd_1"] == pytest.approx(-0.5) and columns["cmd_6"] == pytest.approx(0.5)


def test_a_bag_that_was_cut_is_a_sentence(tmp_path):
    """ROS 1, in the middle."""
    path = ros_bag(tmp_path / "flight.bag", 1)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(FlightLogError, match="flight.bag cannot be read as a ROS bag"):
        streams_of(path)


def array_bag(path, **topics):
    """A bag of ROS 1 with an attitude, and arrays of numbers by topic."""
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag1 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    kind = "std_msgs/msg/Float64MultiArray"
    with Writer(path) as out:
        for name, numbers in topics.items():
            connection = out.add_connection(f"/{name}", kind, typestore=store)
            for k in range(30):
                sent = store.types[kind](layout=layout, data=np.array(numbers, float))
                out.write(connection, (10 + k) * 10**8, store.serialize_ros1(sent, kind))
    return path


@pytest.mark.parametrize(
    ("topics", "cause"),
    [
        ({"states": [0.1] * 10}, r"no topic is called as .* that may be them: /states \(10 numbers\)"),
        ({"thruster_rpm": [0.1] * 6}, r"that may be them: /thruster_rpm \(6 numbers\)"),
        ({"thrusters": [1500.0] * 6}, r"/thrusters \(up to 1.5e\+03\) is called .* no numbers within \[-1, 1\]"),
        ({"thrusters": [0.1] * 6, "motor_cmd": [0.1] * 6}, "/thrusters, /motor_cmd may all be the commands"),
    ],
)
def test_an_array_is_no_command_unless_its_topic_says_so(tmp_path, topics, cause):
    """States of as many numbers as there are thrusters, answers, pulses, two that may be it: listed, and not taken."""
    streams = streams_of(array_bag(tmp_path / "flight.bag", **topics))
    assert "commands" not in streams.streams
    with pytest.raises(FlightLogError, match=cause + r".*Record the commands in \[-1, 1\]"):
        commands_of(streams, {})


def test_commands_are_found_beside_other_arrays(tmp_path):
    """By the name of their topic."""
    path = array_bag(tmp_path / "flight.bag", states=[0.1] * 10, rov_thruster_commands=[0.5] * 6)
    assert streams_of(path).streams["commands"].source == "/rov_thruster_commands"


def test_a_bag_without_definitions_is_read():
    """As mavros wrote it, packed as it lies there; topics of other types, and other vehicles, are named."""
    bag = shared("saab_brov/rosbag2_2025_05_14-15_59_00/metadata.yaml.xz").parent
    streams = streams_of(bag)
    said = {finding.code: finding.sentence for finding in streams.findings}
    assert {"outputs", "gyro", "position", "battery"} <= streams.streams.keys() and streams.armed
    assert streams.streams["position"].source == "/mavros/global_position/local", "sam_mocap is another vehicle"
    assert "topics of other types" in said["topics_left_out"]
    assert streams.streams["attitude"].source == streams.streams["position"].source and "several_sources" in said


def places_bag(path, others):
    """A bag of ROS 1: outputs, IMU and odometry of a level vehicle, and odometry of another name, twice as often."""
    typesys = pytest.importorskip("rosbags.typesys")
    from rosbags.rosbag1 import Writer

    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
    kinds = store.types
    arrays, odometry, imu = "std_msgs/msg/Float64MultiArray", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
    vector, zeros = kinds["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0), np.zeros(9)

    def turned(roll, yaw):
        cr, sr, cy, sy = np.cos(roll / 2), np.sin(roll / 2), np.cos(yaw / 2), np.sin(yaw / 2)
        return kinds["geometry_msgs/msg/Quaternion"](w=cr * cy, x=sr * cy, y=sr * sy, z=cr * sy)

    def message(kind, k, roll, yaw):
        stamp = kinds["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
        header = kinds["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="base_link" if kind == imu else "map")
        if kind == arrays:
            return kinds[kind](layout=kinds["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0), data=np.ones(6))
        if kind == imu:
            return kinds[kind](header, turned(roll, yaw), zeros, vector, zeros, vector, zeros)
        place = kinds["geometry_msgs/msg/Pose"](
            kinds["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0), turned(roll, yaw)
        )
        twist = kinds["geometry_msgs/msg/Twist"](linear=vector, angular=vector)
        both = kinds["geometry_msgs/msg/PoseWithCovariance"], kinds["geometry_msgs/msg/TwistWithCovariance"]
        return kinds[kind](header, "base_link", both[0](place, np.zeros(36)), both[1](twist, np.zeros(36)))

    with Writer(path) as out:
        rows = [("/rov/thrusters", arrays, 10, (0, 0)), ("/rov/imu", imu, 10, (0, 0))]
        rows += [("/rov/odom", odometry, 10, (0, 0)), ("/mocap/odom", odometry, 20, others)]
        for name, kind, hz, (roll, turning) in rows:
            connection = out.add_connection(name, kind, typestore=store)
            for k in range(10 * hz):
                sent = message(kind, k, roll, 0.5 + turning * k / hz)
                out.write(connection, 10**9 + round(k / hz * 1e9), store.serialize_ros1(sent, kind))
    return path


@pytest.mark.parametrize(
    ("others", "taken"), [((0.0, 0.0), "/mocap/odom"), ((1.2, 0.0), "/rov/odom"), ((0.0, 0.3), "/rov/odom")]
)
def test_the_odometry_of_another_vehicle_is_not_taken(tmp_path, others, taken):
    """One that lies on its side, or turns, while the IMU by the commands does not; else the fastest is taken."""
    streams = streams_of(places_bag(tmp_path / "tank.bag", others))
    assert streams.streams["position"].source == streams.streams["attitude"].source == taken
    assert any(finding.code == "several_sources" for finding in streams.findings)


@pytest.mark.parametrize(
    ("parameters", "cause"),
    [
        ({"MAV_TYPE": 2}, r"a quadrotor \(MAV_TYPE\): no underwater"),
        ({"SYS_AUTOSTART": 50000}, r"a rover \(airframe 50000\): no underwater"),
        ({"MAV_TYPE": 12, "SYS_AUTOSTART": 60002}, ""),
    ],
)
def test_a_px4_log_of_another_vehicle_is_named(tmp_path, parameters, cause):
    """By its type or airframe; an underwater vehicle is read."""
    start = ulog_file()
    for name, value in parameters.items():
        key = f"int32_t {name}".encode()
        body = bytes([len(key)]) + key + struct.pack("<i", value)
        start += struct.pack("<HB", len(body), ord("P")) + body
    path = tmp_path / "flight.ulg"
    path.write_bytes(start)
    if cause:
        with pytest.raises(FlightLogError, match=cause):
            tabulate(streams_of(path))
    else:
        assert "cmd_2" in tabulate(streams_of(path)).columns
