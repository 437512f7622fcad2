"""How fast ``auv-sim`` is: ``python -m benchmarks.link`` steps vehicles at 400 Hz as a firmware asks, on one core.

Without sockets, the lock-step alone; and over UDP on the loopback, with a client on the same core that does nothing but
ask for the next frame. ArduSub itself is not in it. Times are of the processor, so that other programs do not count.
"""

import os
import socket
import threading
import time

from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.plant import Plant, Start
from auv_torchrl.link.protocol import Servos, servo_packet
from auv_torchrl.link.server import open_socket, serve
from auv_torchrl.scenario import Scenario, read_scenario
from auv_torchrl.vehicle import load_vehicle

RATE_HZ, SECONDS = 400, 20.0  # of simulated time
AHEAD = (1450, 1450, 1550, 1550, 1500, 1500, 1500, 1500, *(1500,) * 8)
CASES = {
    "healthy": {},
    "thruster 1 reversed": {"thruster_gain": {"gain_1": -1.0}},
    "current, payload": {"current": {"north": 0.2}, "payload": {"mass": 1.0}},
    "commands 0.1 s late": {"command_delay": {"delay": 0.1}},
}


def lockstep_of(effects: dict) -> Lockstep:
    """A vehicle with eight thrusters."""
    vehicle = load_vehicle("bluerov2_heavy")
    scenario = read_scenario("case", {"effects": effects}, vehicle) if effects else Scenario("nominal")
    return Lockstep(Plant(vehicle, scenario, Start(down=2.0)), range(1, vehicle.thrusters + 1))


def alone(lockstep: Lockstep) -> float:
    """Simulated seconds for each of the processor, without sockets."""
    begun, frames = time.process_time(), round(SECONDS * RATE_HZ)
    for frame in range(frames):
        lockstep.answer(servo_packet(Servos(RATE_HZ, frame, AHEAD)), "here")
    return SECONDS / (time.process_time() - begun)


def over_loopback(lockstep: Lockstep) -> float:
    """Likewise, asked over UDP by a client in another thread, whose time counts."""
    over, frames = threading.Event(), round(SECONDS * RATE_HZ)
    with open_socket(("127.0.0.1", 0)) as listener, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.connect(listener.getsockname())
        client.settimeout(60.0)
        thread = threading.Thread(target=serve, args=(listener, lockstep, over.is_set, lambda: None))
        thread.start()
        begun = time.process_time()
        for frame in range(frames):
            client.send(servo_packet(Servos(RATE_HZ, frame, AHEAD)))
            client.recv(65_000)
        passed = time.process_time() - begun
        over.set()
        thread.join()
    return SECONDS / passed


def main() -> None:
    """Print the table."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    print(f"| vehicle, {RATE_HZ} Hz | lock-step alone | over UDP |\n|---|---:|---:|")
    for name, effects in CASES.items():
        lockstep_of(effects).answer(servo_packet(Servos(RATE_HZ, 0, AHEAD)), "here")  # compiles, once
        print(f"| {name} | {alone(lockstep_of(effects)):.1f} x | {over_loopback(lockstep_of(effects)):.1f} x |")


if __name__ == "__main__":
    main()
