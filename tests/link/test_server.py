"""The link over sockets: packets and answers that are lost, and who is answered."""

import socket
import threading
from contextlib import contextmanager

import numpy as np
import pytest

from auv_torchrl.link import server
from auv_torchrl.link.address import parse_address
from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.server import Pace, open_socket, serve
from tests.link.firmware import Firmware, read_answer

HERE = ("127.0.0.1", 0)


class Lossy:
    """A socket that loses some of what is sent on it."""

    def __init__(self, real, lost):
        self._real, self._lost = real, lost

    def __getattr__(self, name):
        return getattr(self._real, name)

    def sendto(self, line, sender):
        return len(line) if next(self._lost) else self._real.sendto(line, sender)


@contextmanager
def answering(wire, lockstep):
    """The link on a socket, in a thread."""
    over = threading.Event()
    thread = threading.Thread(target=serve, args=(wire, lockstep, over.is_set, lambda: None))
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def serving(lockstep, lossy=None):
    """The link on a socket of its own; its address."""
    with open_socket(HERE) as listener, answering(listener if lossy is None else Lossy(listener, lossy), lockstep):
        yield listener.getsockname()


@pytest.fixture
def lockstep(plant):
    """Of a healthy vehicle."""
    return Lockstep(plant(), range(1, 9))


def test_a_flight_is_the_same_whatever_is_lost_on_the_way(plant):
    """A fifth of all answers lost, garbage between them and a restart: the numbers of an undisturbed flight."""
    pwm = np.random.default_rng(0).integers(1100, 1900, (80, 16)).tolist()

    def fly(address, disturbed):
        lines = []
        for _ in range(2):
            firmware = Firmware(address, timeout_s=0.1)
            for number, pulses in enumerate(pwm):
                if disturbed and number % 7 == 0:
                    firmware.send_bytes(b"\0" * (number % 45))
                lines.append(read_answer(firmware.exchange(pulses)))
            firmware.close()
        return lines

    draws = np.random.default_rng(1)
    disturbed = Lockstep(plant(), range(1, 9))
    with serving(Lockstep(plant(), range(1, 9))) as address:
        expected = fly(address, False)
    with serving(disturbed, iter(lambda: draws.random() < 0.2, None)) as address:
        assert fly(address, True) == expected
    assert expected[:80] == expected[80:]
    assert disturbed.counts["frame"] == 160 and disturbed.counts["repeated"] > 20
    assert disturbed.counts["garbage"] > 20 and disturbed.counts["restart"] == 1


def test_the_answer_goes_to_where_the_packet_came_from_and_to_nobody_else(lockstep):
    """Somebody who sends no servos hears nothing."""
    with serving(lockstep) as address:
        firmware, other = Firmware(address), Firmware(address)
        other.send_bytes(b"hello")
        firmware.exchange()
        assert other.nothing_comes()
        firmware.exchange()
        firmware.close()
        other.close()


def test_of_questions_that_wait_the_last_is_answered(lockstep):
    """A link that slept answers once: with more answers than questions the firmware would lag behind for ever."""
    with open_socket(HERE) as listener:
        firmware = Firmware(listener.getsockname())
        for _ in range(5):
            firmware.send()
        with answering(listener, lockstep):
            assert read_answer(firmware.receive()).timestamp == 0.0025
            assert read_answer(firmware.exchange()).timestamp == 0.005
            assert firmware.nothing_comes()
            firmware.close()
    assert lockstep.counts["repeated"] == 4


class Slow:
    """A lock-step during whose first step something happens."""

    def __init__(self, lockstep, *during):
        self._lockstep, self._during = lockstep, list(during)

    def answer(self, packet, sender):
        line = self._lockstep.answer(packet, sender)
        while self._during:
            self._during.pop()()
        return line


def test_a_question_that_is_asked_again_during_a_slow_step_has_one_answer(lockstep):
    """That of the step, which is flown once."""
    with open_socket(HERE) as listener:
        firmware = Firmware(listener.getsockname())
        with answering(listener, Slow(lockstep, firmware.send, firmware.send)):
            assert read_answer(firmware.exchange()).timestamp == 0.0025
            assert read_answer(firmware.exchange()).timestamp == 0.005
            assert firmware.nothing_comes()
            firmware.close()
    assert lockstep.counts == {"frame": 2, "repeated": 2}


def test_a_question_that_crosses_its_answer_has_no_second_one(lockstep, monkeypatch):
    """It was asked again when the answer was on its way, and the next question follows."""
    monkeypatch.setattr(server, "CROSSED_S", 30.0)  # the next question comes in time however busy the machine is
    with serving(lockstep) as address:
        firmware = Firmware(address)
        firmware.send()
        first = firmware.look()
        firmware.send()
        assert firmware.receive() == first
        assert read_answer(firmware.exchange()).timestamp == 0.005
        assert firmware.nothing_comes()
        firmware.close()
    assert lockstep.counts == {"frame": 2, "repeated": 1}


def test_a_firmware_that_is_an_answer_behind_catches_up(lockstep):
    """It asks for a frame before the last one is answered: both are flown, and the newer one alone is answered."""
    with open_socket(HERE) as listener:
        firmware = Firmware(listener.getsockname())
        firmware.send()
        firmware.frame = 1
        firmware.send()
        with answering(listener, lockstep):
            assert read_answer(firmware.receive()).timestamp == 0.005
            assert read_answer(firmware.exchange()).timestamp == 0.0075
            assert firmware.nothing_comes()
            firmware.close()
    assert lockstep.counts == {"frame": 3}


def test_a_packet_longer_than_any_of_ours_is_none(lockstep):
    """Also where its beginning is one."""
    with serving(lockstep) as address:
        firmware = Firmware(address)
        firmware.send()
        first = firmware.receive()
        firmware.send_bytes(b"\0" * 60_000)
        assert firmware.nothing_comes()
        assert read_answer(firmware.exchange()).timestamp > read_answer(first).timestamp
        firmware.close()
    assert lockstep.counts["garbage"] == 1


@pytest.mark.parametrize("bind", ["127.0.0.1:9002", "localhost:9002", "127.0.0.2:9002"])
def test_the_loopback_is_listened_at(bind):
    """Without being asked."""
    host, port = parse_address(bind, elsewhere=False)
    assert host.startswith("127.") and port == 9002


@pytest.mark.parametrize("bind", ["0.0.0.0:9002", "192.168.2.1:9002"])
def test_another_address_needs_to_be_said_twice(bind):
    """Whoever reaches it flies the vehicle."""
    with pytest.raises(ValueError, match="elsewhere=true"):
        parse_address(bind, elsewhere=False)
    assert parse_address(bind, elsewhere=True) == (bind[:-5], 9002)


@pytest.mark.parametrize("bind", ["", "9002", "127.0.0.1", "127.0.0.1:", "127.0.0.1:70000", "::1:9002", "boat:9002",
                                  ":9", "127.0.0.1:-1", "127.0.0.1:\u0663"])  # fmt: skip
def test_what_is_no_address_is_refused(bind):
    """With one that is."""
    with pytest.raises(ValueError, match="give one like bind=127.0.0.1:9002"):
        parse_address(bind, elsewhere=True)


def test_a_port_that_is_used_and_an_address_of_another_machine_are_refused():
    """Each says what to do."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(HERE)
        with pytest.raises(ValueError, match="used by another program: end it"):
            open_socket(other.getsockname())
    with pytest.raises(ValueError, match="give an address of this machine"):
        open_socket(("192.0.2.1", 9002))


def test_the_pace_is_simulated_time_by_the_clock():
    """Over the last second, not since the start."""
    now = [0.0]
    pace = Pace(lambda: now[0])
    assert not pace.look(5.0)
    now[0] = 2.0
    assert pace.look(10.0) and pace.times_real == 5.0
    now[0] = 3.0
    assert pace.look(40.0) and pace.times_real == 30.0
