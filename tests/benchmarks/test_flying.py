"""What is sealed is what it says it is."""

from collections import Counter

import numpy as np
import pytest

from auv_torchrl.effects import get_effect
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.simulator import record
from auv_torchrl.vehicle import CONTROLLED_INDEX, load_vehicle
from benchmarks.blind.flights.cases import FAMILIES, ONE_CAN_HIDE_THE_OTHER, Case, count_by_family, draw_cases
from benchmarks.blind.flights.fly import SealedPlant, fly
from benchmarks.blind.flights.foreign import ForeignPlant
from benchmarks.blind.flights.influence import CLEAR_AT, influence
from benchmarks.blind.flights.mujoco_plant import MujocoPlant
from benchmarks.blind.flights.outside import OUTSIDE, Outside
from benchmarks.blind.flights.plant import Influences, Slack
from benchmarks.blind.flights.sizes import (
    CLEAR,
    COEFFICIENTS,
    HORIZONTAL,
    NOT_A_GAP,
    NOT_LOGGED,
    NOT_MET,
    NOT_TELLABLE,
    draw_failures,
    draw_values,
)
from benchmarks.blind.flights.strangers import with_changes
from tests.hovering import ACTING

VEHICLE = load_vehicle("paper")
# m. Roll and pitch move in MuJoCo and are held in the foreign simulator, which three effects notice; a command that is
# late by a fraction of a step is averaged over the step there and exact here.
APART = {"mass_offset": 0.2, "payload": 0.02, "coriolis": 0.08, "command_delay": 0.06}


def swim(plant, seconds=6.0, influences=None, seed=0, distinct=None):
    """Reported poses of a plant under smooth commands, (steps, rows, 6).

    The starts and commands of the first ``distinct`` rows are those of all further ones; without it each has its own.
    """
    rng = np.random.default_rng(seed)
    rows = distinct or plant.rows
    again = np.arange(plant.rows) % rows
    start = rng.uniform(-1, 1, (rows, 3)), rng.uniform(-3, 3, rows), rng.uniform(-0.2, 0.2, (rows, 4))
    plant.reset(*(part[again] for part in start))
    size, rate, phase = (rng.uniform(low, high, (rows, 4))[again] for low, high in ((0.2, 0.6), (0.3, 2.0), (0.0, 6.0)))
    mixer = VEHICLE.mixer[:, list(CONTROLLED_INDEX)]  # the two vertical thrusters together: no roll
    influences = influences or Influences.none(plant.rows, 6)
    poses = []
    for step in range(round(seconds / CONTROL_DT)):
        poses.append(plant.reported().pose)
        demand = size * np.sin(rate * step * CONTROL_DT + phase)
        plant.step(np.clip(demand @ mixer.T, -1, 1), influences)
    return np.stack(poses)


def distance(one, other):
    return np.linalg.norm(one[..., :3] - other[..., :3], axis=-1)


def test_sizes_cover_the_registry():
    """Every effect that opens a gap of its own has a clear size."""
    others = {*NOT_A_GAP, *NOT_LOGGED, *NOT_TELLABLE, *NOT_MET, *COEFFICIENTS}
    assert set(CLEAR) | others == set(ACTING)


@pytest.mark.parametrize("failed", [2, 3])
def test_failed_thrusters_are_as_many_as_asked_for(failed):
    """Several thrusters fail, each one in its own way, and no vertical one, which shares its command with another."""
    for seed in range(20):
        values = draw_failures(VEHICLE, np.random.default_rng(seed), failed)
        faulty = {name: gain for name, gain in values.items() if gain != 1.0}
        assert len(set(faulty.values())) == failed
        assert set(faulty) <= {f"gain_{i}" for i in HORIZONTAL}


@pytest.fixture(scope="module")
def flown_in_both():
    """Poses (steps, 4, 6) from both simulators by effect, and of nominal vehicles as None: all fly at once."""
    rows = {effect: slice(4 * i, 4 * i + 4) for i, effect in enumerate((*CLEAR, None))}
    plants = MujocoPlant(VEHICLE, 4 * len(rows), CONTROL_DT), ForeignPlant(4 * len(rows), CONTROL_DT)
    for plant in plants:
        for effect in CLEAR:
            plant.change(rows[effect], effect, draw_values(effect, VEHICLE, np.random.default_rng(3)))
    both = [swim(plant, distinct=4) for plant in plants]
    return {effect: [poses[:, part] for poses in both] for effect, part in rows.items()}


@pytest.mark.parametrize("effect", CLEAR)
def test_the_two_simulators_agree_on_every_effect(flown_in_both, effect):
    """Two codes that share nothing fly the same effect to the same place, and the effect is not nothing."""
    (mujoco, foreign), (_, nominal) = flown_in_both[effect], flown_in_both[None]
    apart = distance(mujoco, foreign).max()
    assert apart < APART.get(effect, 0.002)
    shows = np.abs(np.angle(np.exp(1j * (foreign - nominal)[..., 5]))).max() + distance(foreign, nominal).max()
    assert shows > 2 * apart or effect in APART


def test_the_two_simulators_agree_on_slack_and_influences():
    """Slack, thrust factors, forces and currents mean the same in both."""
    rng = np.random.default_rng(0)
    slack = Slack.draw(rng, 0.1, 6)
    influences = Influences(rng.uniform(0.5, 1, (3, 6)), rng.uniform(-9, 9, (3, 3)), rng.uniform(-0.2, 0.2, (3, 3)))
    plants = MujocoPlant(VEHICLE, 3, CONTROL_DT), ForeignPlant(3, CONTROL_DT)
    for plant in plants:
        plant.loosen(slice(0, 3), slack)
    mujoco, foreign = (swim(plant, influences=influences) for plant in plants)
    assert distance(mujoco, foreign).max() < 0.03  # thrusters 5 and 6 differ: a little roll in MuJoCo
    assert distance(mujoco, swim(MujocoPlant(VEHICLE, 3, CONTROL_DT))).max() > 0.1


def test_foreign_simulator_refuses_what_it_does_not_know():
    """An unknown effect or parameter is an error, not a flight without it."""
    with pytest.raises(ValueError, match="no effect 'kelp'"):
        ForeignPlant(1, CONTROL_DT).change(slice(0, 1), "kelp", {})
    with pytest.raises(ValueError, match="no parameters"):
        ForeignPlant(1, CONTROL_DT).change(slice(0, 1), "current", {"north": 0.1, "up": 0.2})


@pytest.mark.parametrize("effect", CLEAR)
def test_sizes_lie_within_the_bounds_and_shrink_to_nominal(effect):
    """Every draw is allowed, and a small scale is a small effect of the same kind."""
    nominal = get_effect(effect).nominal(VEHICLE)
    for seed in range(20):
        values = draw_values(effect, VEHICLE, np.random.default_rng(seed))
        assert get_effect(effect).read(VEHICLE, values) == values
        if effect == "thruster_swap":
            continue
        small = draw_values(effect, VEHICLE, np.random.default_rng(seed), scale=0.1)
        places = ("north", "east", "down", "slack", "x", "y")
        changed = [k for k in values if values[k] != nominal[k] and k not in places]
        assert all(np.isclose(small[k] - nominal[k], 0.1 * (values[k] - nominal[k])) for k in changed)


@pytest.fixture(scope="module")
def labels_outside():
    """What is known of a flight with each effect outside the library, by its name."""
    flown = {"plant": "foreign", "episodes": 2, "episode_s": 12.0}
    cases = [Case(number, "outside", outside=name, **flown) for number, name in enumerate(OUTSIDE, 1)]
    return {label["outside"]: label for _, label in fly(cases, VEHICLE, seed=0)}


@pytest.mark.parametrize("name", OUTSIDE)
def test_every_effect_outside_the_library_acts(labels_outside, name):
    """None of them is a stub."""
    effect = OUTSIDE[name](np.random.default_rng(0), 2, 6, CONTROL_DT)
    hooks = ("received", "act", "heading_error")
    assert any(getattr(type(effect), hook) is not getattr(Outside, hook) for hook in hooks)
    assert labels_outside[name]["influence"][name] >= CLEAR_AT


SENSED = [(0.13, 0.0, 1.0), (0.0, 0.3, 1.3), (0.13, 0.3, 1.3)]  # s late, rad turned, factor scaled


def sensed(late, turned, scaled):
    """Effects on the sensors of a vehicle, and one that does not change them."""
    return {
        "pose_delay": {"delay": late},
        "heading_bias": {"angle": turned},
        "position_scale": {"factor": scaled},
        "thruster_gain": {"gain_2": 0.5},
    }


@pytest.mark.parametrize("plant", [MujocoPlant, ForeignPlant])
def test_what_is_wholly_known_has_no_influence(plant):
    """Sensors that are late, turned and scaled together are followed where all of it is known, within the noise."""
    rows = len(SENSED)
    swimming = plant(rows, CONTROL_DT) if plant is ForeignPlant else plant(VEHICLE, rows, CONTROL_DT)
    for row, wrong in enumerate(SENSED):
        for name, values in sensed(*wrong).items():
            swimming.change(slice(row, row + 1), name, values)
    swimming.reset(np.zeros((rows, 3)), np.ones(rows), np.zeros((rows, 4)))
    mixer = VEHICLE.mixer[:, list(CONTROLLED_INDEX)]

    def command(time, measured):
        return np.tile(0.3 * np.sin(np.array([[0.9, 1.3, 0.7, 1.1]]) * time) @ mixer.T, (rows, 1))

    pose, velocity, _, sent = record(SealedPlant(swimming, []), command, 240, CONTROL_DT)
    for row, wrong in enumerate(SENSED):
        flown = with_changes(VEHICLE, [sensed(*wrong)])
        logged = pose[[row]], velocity[[row]], sent[[row]]
        assert influence(flown, flown, *logged) < 1.0, wrong
        assert influence(VEHICLE, flown, *logged) > CLEAR_AT, wrong


def test_a_case_depends_on_its_number_and_the_seed_alone():
    """Logs can be flown again one by one, in any company."""
    cases = [Case(n, "single", effects=("current",), episodes=1, episode_s=5.0, plant="foreign") for n in (1, 2)]
    together = fly(cases, VEHICLE, seed=5)
    alone = fly(cases[1:], VEHICLE, seed=5)
    assert together[1][1] == alone[0][1]
    np.testing.assert_array_equal(together[1][0].episodes[0].pose, alone[0][0].episodes[0].pose)
    assert together[0][1]["values"] != together[1][1]["values"]


def test_an_onset_begins_where_the_label_says():
    """Before the onset the flight is the nominal one, after it it is not."""
    case = Case(1, "onset", effects=("thruster_swap",), episodes=1, episode_s=12.0, onset=True, plant="foreign")
    twin = Case(1, "no_gap", episodes=1, episode_s=12.0, onset=True, plant="foreign")
    ((log, label),) = fly([case], VEHICLE, seed=2)
    plant = ForeignPlant(1, CONTROL_DT)
    episode = log.episodes[0]
    plant.reset(episode.pose[:1, :3], episode.pose[:1, 5], np.zeros((1, 4)))
    error = []
    for k, command in enumerate(episode.commands):
        error.append(float(distance(plant.reported().pose[0], episode.pose[k])))
        plant.step(command[None], Influences.none(1, 6))
    onset = int(label["onset_s"] / CONTROL_DT)
    assert max(error[:onset]) < 0.25 < max(error[onset:])  # it does not start at rest
    assert twin.truth == "no_gap"


def test_families_keep_their_shares():
    """Cases are split by the shares, all of them, at any number."""
    shares = {family: 1.0 + i for i, family in enumerate(FAMILIES)}
    for cases in (1, 6, 40, 301):
        counts = count_by_family(cases, shares)
        assert sum(counts.values()) == cases
        assert all(abs(counts[f] - cases * shares[f] / sum(shares.values())) < 1 for f in FAMILIES)
        assert len(draw_cases(cases, shares, seed=0)) == cases


@pytest.mark.parametrize(
    ("cases", "shares", "message"),
    [
        (5, {"singel": 1.0}, "unknown families"),
        (5, {}, "shares"),
        (5, {"single": -1.0}, "shares"),
        (0, {"single": 1.0}, "1 or more"),
    ],
)
def test_bad_families_are_refused(cases, shares, message):
    """A misspelt family, no share or no case is an error."""
    with pytest.raises(ValueError, match=message):
        draw_cases(cases, shares, seed=0)


def test_every_effect_is_in_as_many_pairs_as_the_others():
    """In 44 pairs each of the 22 effects acts four times, beside another one that a log can tell from it."""
    pairs = [case.effects for case in draw_cases(44, {"pair": 1.0}, seed=1)]
    assert set(Counter(name for pair in pairs for name in pair).values()) == {4}
    assert all(one != other and {one, other} not in ONE_CAN_HIDE_THE_OTHER for one, other in pairs)


def test_each_effect_is_left_out_once_in_a_full_benchmark():
    """The shipped shares take every effect out of the library."""
    cases = draw_cases(len(CLEAR), {"left_out": 1.0}, seed=1)
    assert {case.left_out for case in cases} == set(CLEAR)
    assert {case.truth for case in cases} == {"unknown"}
