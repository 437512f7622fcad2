"""Lock-step with a firmware that loses packets, asks again, starts anew, or is another one."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.link.lockstep import SILENT_S, step_of
from auv_torchrl.link.plant import LONGEST_STEP_S, Plant, Start
from auv_torchrl.link.protocol import Servos, servo_packet
from auv_torchrl.scenario import Scenario
from tests.link.conftest import Wire
from tests.link.firmware import read_answer

AHEAD = (1400, 1400, 1600, 1600, *(1500,) * 12)


def test_each_frame_is_one_step_and_a_repeated_one_is_answered_alike(wire):
    """The same bytes, and the vehicle has not moved."""
    link = wire()
    packet = servo_packet(Servos(400, 0, AHEAD))
    first = link.lockstep.answer(packet, "a")
    assert read_answer(first).timestamp == 0.0025
    assert link.lockstep.answer(packet, "a") == first
    assert link.send(0, rate=100).timestamp == 0.0025  # whatever else it says
    assert link.send(1, AHEAD).timestamp == 0.005
    assert link.lockstep.counts == {"frame": 2, "repeated": 2}


@pytest.mark.parametrize("sender", ["a", "b"])
def test_a_firmware_that_was_started_anew_finds_the_vehicle_at_its_start(wire, sender):
    """At frame 0 again, from the same address or another one; its clock begins at 0 as that of the physics does."""
    link = wire()
    first = [link.send(frame, AHEAD) for frame in range(40)]
    assert [link.send(frame, AHEAD, sender=sender) for frame in range(40)] == first
    assert link.lockstep.counts["restart"] == 1


def test_a_packet_that_was_late_is_left_and_one_that_is_asked_for_again_is_not(wire):
    """A late one is not sent twice; a firmware at a lower frame asks until it is answered."""
    link = wire()
    for frame in range(5):
        link.send(frame)
    assert link.send(2) is None
    assert link.send(3) is None
    assert link.send(5).timestamp == pytest.approx(6 / 400)
    assert link.send(2) is None
    assert link.send(2).timestamp == 1 / 400


def test_the_physics_that_was_started_anew_goes_on_with_a_firmware_that_flies(wire):
    """It takes the frame that it gets, from its own 0 s; ArduSub calls that a physics reset and goes on."""
    link = wire()
    assert link.send(70_000).timestamp == 0.0025
    assert link.send(70_001).timestamp == 0.005


def test_one_firmware_flies_at_a_time(wire):
    """Another one that is in flight is not answered, until the first has been silent."""
    link = wire()
    for frame in range(3):
        link.send(frame, AHEAD)
    assert link.send(7, sender="b") is None
    assert link.send(3, AHEAD).timestamp == 0.01
    link.now += 1.01 * SILENT_S
    assert link.send(8, sender="b").timestamp == 0.0025
    assert link.send(4, AHEAD) is None
    assert link.lockstep.counts["stranger"] == 2


@pytest.mark.parametrize("packet", [b"", b"\0" * 40, servo_packet(Servos(400, 0, AHEAD))[:-1], b"{}"])
def test_what_is_no_packet_is_not_answered_and_moves_nothing(wire, packet):
    """Whoever sent it."""
    link = wire()
    link.send(0)
    assert link.lockstep.answer(packet, "a") is None
    assert link.lockstep.answer(packet, "c") is None
    assert link.send(1).timestamp == 0.005


def test_a_firmware_may_change_its_rate_while_it_flies(wire):
    """The step is that of the frame; ArduSub comes down from 1200 Hz to what it was asked for."""
    link = wire()
    rates = [1200, 1199, 1198, 761, 400, 400, 50]
    times = [link.send(frame, rate=rate).timestamp for frame, rate in enumerate(rates)]
    assert times == pytest.approx([sum(1 / rate for rate in rates[: n + 1]) for n in range(len(rates))])


@pytest.mark.parametrize(("rate", "step"), [(0, LONGEST_STEP_S), (1, LONGEST_STEP_S), (20, 0.05), (65535, 1 / 65535)])
def test_a_rate_that_the_physics_cannot_follow_is_the_slowest_that_it_can(rate, step):
    """No rate at all, too."""
    assert step_of(rate) == step


def test_16_and_32_outputs_fly_alike(wire):
    """Also where their number changes in flight."""
    one, other = wire(), wire()
    for frame in range(10):
        wide = AHEAD + (1500,) * 16 if frame % 2 else AHEAD
        assert one.send(frame, AHEAD) == other.send(frame, wide)


def test_an_output_that_does_not_come_stands_still_and_is_named(vehicle, caplog):
    """Thruster 8 on output 20, of which 16 come."""
    link = Wire(Plant(vehicle, Scenario("nominal"), Start()))
    link.lockstep.outputs = (*range(1, 8), 20)
    for frame in range(2):
        link.send(frame, (1900,) * 16)
    assert link.lockstep.plant.moment.thrust[0, 7] == 0 < link.lockstep.plant.moment.thrust[0, 6]
    assert [record.message[:69] for record in caplog.records if record.levelname == "WARNING"] == [
        "outputs come up to number 16, and thruster 8 is driven by output 20: "
    ]


class Count:
    """Counts steps, and when they were."""

    def __init__(self):
        self.steps, self.placed = 0, 0

    def begin(self, moment):
        self.placed += 1
        assert moment.time_s == 0.0

    def flown(self, command, moment):
        self.steps += 1
        assert all(-1 <= value <= 1 for value in command)


PULSES = st.lists(st.one_of(st.integers(1000, 2000), st.integers(0, 65535)), min_size=16, max_size=16)
HAPPENING = st.one_of(
    st.tuples(st.just("fly"), PULSES, st.sampled_from((16, 32))),
    st.tuples(st.just("repeat"), st.integers(1, 3)),
    st.tuples(st.just("lost answer"), st.integers(1, 3)),
    st.tuples(st.just("lost packet"), PULSES),
    st.tuples(st.just("late"), st.integers(2, 9)),
    st.tuples(st.just("garbage"), st.binary(max_size=73), st.sampled_from("ab")),
    st.tuples(st.just("broken"), st.integers(0, 39), st.integers(1, 255)),
    st.tuples(st.just("rate"), st.integers(0, 65535)),
    st.tuples(st.just("restart"), st.booleans()),
    st.tuples(st.just("silence"), st.floats(0, 10)),
)


@pytest.fixture(scope="module")
def flown(vehicle):
    """One plant for all examples, its delays included: to make one takes longer than to fly it."""
    delayed = vehicle.replace(delay=vehicle.delay + 0.03, pose_delay=vehicle.pose_delay + 0.02)
    return Plant(delayed, Scenario("nominal"), Start())


class Exchange:
    """A firmware and all that may happen on the way, beside what must come of it."""

    def __init__(self, plant):
        plant.reset()
        self.seen = Count()
        self.wire = Wire(plant, [self.seen])
        self.frame, self.rate, self.sender, self.before_s, self.line, self.accepted = 0, 400, "a", 0.0, None, 0
        self.packet = b""

    def answer(self, packet):
        return self.wire.lockstep.answer(packet, self.sender)

    def fly(self, pulses, outputs=16):
        """A frame is answered once, later than the one before."""
        self.packet = servo_packet(Servos(self.rate, self.frame, tuple(pulses) * (outputs // 16)))
        self.line = self.answer(self.packet)
        assert self.line is not None
        self.accepted += 1
        told = read_answer(self.line)
        assert all(math.isfinite(value) for part in told[1:] for value in part)
        assert told.timestamp > self.before_s
        self.before_s = told.timestamp
        self.frame += 1

    def happen(self, name, *given):
        """One thing happens."""
        if name == "fly":
            self.fly(*given)
        elif name in ("repeat", "lost answer") and self.line is not None:
            assert [self.answer(self.packet) for _ in range(given[0])] == [self.line] * given[0]
        elif name == "late" and self.frame - given[0] > 0:
            old = servo_packet(Servos(self.rate, self.frame - given[0], (1600,) * 16))
            if self.wire.lockstep._late_frame != self.frame - given[0]:
                assert self.answer(old) is None
        elif name == "garbage":
            sender = given[1]
            assert self.wire.lockstep.answer(given[0], sender) is None
        elif name == "broken" and given[0] < 2:  # in the magic: elsewhere it would be another packet, not a broken one
            packet = bytearray(servo_packet(Servos(self.rate, self.frame, (1900,) * 16)))
            packet[given[0]] ^= given[1]
            assert self.answer(bytes(packet)) is None
        elif name == "rate":
            self.rate = given[0]
        elif name == "restart" and self.frame > 1:
            self.frame, self.before_s, self.line = 0, 0.0, None
            self.sender = ("b" if self.sender == "a" else "a") if given[0] else self.sender
            self.fly((1500,) * 16)
        elif name == "silence":
            self.wire.now += given[0]


@settings(max_examples=60)
@given(st.lists(HAPPENING, min_size=5, max_size=60))
def test_whatever_happens_on_the_way_each_frame_is_flown_once(flown, happenings):
    """Finite, later than the one before, never twice; losses, repeats, late ones, garbage, restarts, other rates."""
    exchange = Exchange(flown)
    for name, *details in happenings:
        exchange.happen(name, *details)
        assert exchange.seen.steps == exchange.accepted == exchange.wire.lockstep.counts["frame"]
    assert exchange.seen.placed == exchange.wire.lockstep.counts["restart"] + (exchange.accepted > 0)
