"""A vehicle that stands on the bottom or hangs at the surface is not taken for a faulty one."""

import numpy as np
import pytest
from flown_logs import AXES, DT, Pushed, fly, hold

from auv_torchrl.diagnosis import Verdict, diagnose
from auv_torchrl.diagnosis.identify.hypotheses import apply_values
from auv_torchrl.flightlog import Episode, FlightLog
from auv_torchrl.flightlog.checks.contact import NEAR_M, _Flown, _level, leave_out_contact
from auv_torchrl.simulator import PlainSimulator, at_rest, record
from auv_torchrl.vehicle import load_vehicle

PAPER = hold(load_vehicle("paper"))
STIFF, DAMPED = 2000.0, 250.0  # N/m and N s/m of sand, which a vehicle sinks into by a few centimetres


def dive(
    stops: dict[float, float], steps: list[float], values=None, seconds: float = 60.0, start: float = 0.0, seed: int = 0
) -> FlightLog:
    """A dive from a depth on, with the heave ``steps`` in turn and all other axes excited.

    ``stops`` are the depths in m at which something stops the vehicle, by the sense in which it cannot go on.
    """
    rng = np.random.default_rng(seed)
    count = round(seconds / DT)
    other = np.repeat(rng.uniform(-0.4, 0.4, (count // 20 + 1, 4)), 20, axis=0)[:count]
    other[:, 2] = np.repeat(steps, -(-count // len(steps)))[:count]
    commands = np.clip(other @ PAPER.mixer[:, [0, 1, 2, 5]].T, -1, 1)

    def push(sent, position, velocity, t):
        force = np.zeros((1, 3))
        for sense, depth in stops.items():
            into = sense * (position[:, 2] - depth)
            force[:, 2] -= np.where(into > 0, sense * STIFF * into + DAMPED * velocity[:, 2], 0.0)
        return sent, force

    simulator = PlainSimulator(apply_values(PAPER, values or {}).expand(1), DT)
    simulator.resume(at_rest(np.array([[0.0, 0.0, start]]), np.zeros(1), PAPER.thrusters))
    jitter = rng.standard_normal((count, 1, 6)) * np.repeat((0.002, 0.004), 3)

    def pilot(time, seen):
        return np.round(commands[[min(round(time / DT), count - 1)]], 4)

    flown = record(Pushed(simulator, push), pilot, count, DT, jitter)
    pose = flown.measured[0]
    pose[:, 3:5] = np.nan
    t = DT * np.arange(count, dtype=float)
    return FlightLog("dive", (Episode(0, t, pose, np.full_like(pose, np.nan), flown.commands[0]),), AXES)


DOWN = [0.4, 0.9, 0.5, 0.95, 0.45, 0.9]  # of full thrust, a sixth of the dive each
UP = [-step for step in DOWN]
BOTH = [0.5, -0.4, 0.3, -0.5, 0.6, -0.3]


@pytest.mark.parametrize(("sense", "steps", "where"), [(1.0, DOWN, "on the bottom"), (-1.0, UP, "at the surface")])
def test_what_was_flown_in_contact_is_left_out(sense, steps, where):
    """What is left is clear of it, and the finding says where it stood and for how long."""
    start, stop = -sense * 8.0, sense * 2.0
    log = dive({sense: stop}, steps, start=start)
    episodes, (finding,) = leave_out_contact(log.episodes, PAPER)
    assert finding.code == "contact" and where in finding.sentence and not finding.limits
    depth = sense * np.concatenate([episode.pose[:, 2] for episode in episodes])
    assert depth.max() < sense * stop
    clear = sense * log.episodes[0].pose[:, 2] < sense * stop - 2 * NEAR_M
    assert len(depth) >= 0.95 * clear.sum()


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"buoyancy": {"force": 15.0}},
        {"buoyancy": {"force": -15.0}},
        {"thruster_gain": {"gain_5": 0.0, "gain_6": 0.0}},
        {"thruster_gain": {"gain_5": 0.0}},
        {"quadratic_drag": {"scale_heave": 5.0}},
        {"linear_drag": {"scale_heave": 4.0}},
    ],
    ids=str,
)
@pytest.mark.parametrize(
    "steps", [BOTH, DOWN, pytest.param([0.3] * 6, marks=pytest.mark.thorough)], ids=["both ways", "down", "steady"]
)
def test_a_vehicle_in_open_water_stands_nowhere(values, steps):
    """Neither dead vertical thrusters nor a vehicle that has to be held down is taken for one in contact."""
    log = dive({}, steps, values)
    episodes, findings = leave_out_contact(log.episodes, PAPER)
    assert episodes is log.episodes and not findings


@pytest.mark.parametrize(
    "values",
    [
        {},
        {"buoyancy": {"force": 20.0}},
        {"thruster_gain": {"gain_5": -1.0}},
        {"thruster_gain": {"gain_5": -1.0, "gain_6": -1.0}},
        {"thruster_swap": {"command_5": 1.0, "command_1": 5.0}},
        {"command_delay": {"delay": 0.6}},
        {"dead_band": {"width": 15.0}},
        {"tether": {"down": -2.0, "stiffness": 40.0}},
        {"depth_scale": {"factor": 0.2}},
    ],
    ids=str,
)
@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in (1, 2))])
def test_a_vehicle_that_holds_its_depth_stands_nowhere(values, seed):
    """Nor does one that holds its place well or badly, with whatever fault."""
    log = fly(PAPER, values, seed=seed)
    episodes, findings = leave_out_contact(log.episodes, PAPER)
    assert episodes is log.episodes and not findings


def test_a_file_that_makes_the_vehicle_slow_hides_no_bottom():
    """A vehicle that flies at twice the speed of its file bounces on the bottom faster than that file calls still."""
    flown = np.repeat([0.9, 0.02, 0.1, 0.02], [40, 40, 10, 10])  # m/s, in blocks of half a second
    push = np.where(np.arange(100) % 10 < 5, 20.0, 80.0)
    depth = np.concatenate([np.linspace(0.0, 18.0, 40), np.full(60, 18.4)])
    assert _level([_Flown(depth, flown, push)], 51.5, 0.44) == pytest.approx(18.4)
    assert _level([_Flown(depth, np.where(flown == 0.1, 0.3, flown), push)], 51.5, 0.44) is None


def test_a_log_that_is_all_contact_is_kept_and_doubted():
    """Where less than 10 s would be left nothing is left out, and the finding limits what is concluded."""
    log = dive({1.0: 3.0}, DOWN, seconds=40.0)
    episodes, (finding,) = leave_out_contact(log.episodes, PAPER)
    assert episodes is log.episodes and finding.limits


def test_a_sound_vehicle_that_stood_on_the_bottom_is_sound():
    """Nothing is named of it, although the bottom pushed it up with as much as its thrusters down."""
    log = dive({1.0: 6.0}, [0.15, *DOWN], start=-6.0, seconds=90.0)
    episodes, _ = leave_out_contact(log.episodes, PAPER)
    assert diagnose(FlightLog("dive", episodes, AXES), PAPER).verdict is Verdict.NO_GAP
