"""All engines of the benchmark of simulated seconds fly the same motion, and its table says what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl import extras
from auv_torchrl.extras import MissingLibrary
from auv_torchrl.physics import ActiveTerms, control_step, prepare, rest_state
from auv_torchrl.vehicle import load_vehicle
from benchmarks.control import engines, simulated_seconds
from benchmarks.control.engines import CHUNK, ENGINES, ByRollout, World

COUNT = 3
# mm after a second: the same equations in double and single precision; MuJoCo's own order of sums; a mean force per
# step, whose path bends otherwise within a step of 12.5 ms; Euler, which is half a step of the velocity ahead.
EXACT, ROUNDED, MEAN_FORCE, EULER = 1e-9, 0.01, 0.5, 5.0
MOST_APART_MM = {
    "array physics, torch": ROUNDED, "array physics, numpy": EXACT, "MuJoCo fleet": ROUNDED,
    "TorchFleet": ROUNDED, "MujocoFleet": ROUNDED, "the physics' lines on numpy": EXACT,
    "the physics' lines on JAX": ROUNDED, "the physics' lines on JAX, double": EXACT,
    "mujoco.rollout, a model per body": MEAN_FORCE, "mujoco.rollout, one model": MEAN_FORCE,
    "mujoco.rollout, one model, Euler": EULER, "stable-baselines3, DummyVecEnv": ROUNDED,
}  # fmt: skip


@pytest.fixture(scope="module")
def world():
    return World.drawn(COUNT)


@pytest.mark.parametrize("name", ENGINES)
def test_an_engine_flies_the_motion_of_the_plain_equations(name, world):
    """After a second it is where they are, and has moved by a thousand times as much or more."""
    try:
        _, timed = simulated_seconds.made_ready(name, world)
    except MissingLibrary as missing:
        pytest.skip(str(missing))
    assert 1e3 * timed.apart_m < MOST_APART_MM[name]
    moved = np.linalg.norm(world.motion[-1].position - world.start.position, axis=-1)
    assert moved.min() > 0.01


def test_an_engine_that_flies_elsewhere_is_not_timed(world, monkeypatch):
    """Forces of half the size are found out."""
    half = replace(world, commands=world.commands / 2)
    entry = ENGINES["array physics, numpy"]
    other = engines.Entry(lambda _: entry.build(half), entry.precision, entry.what)
    monkeypatch.setitem(ENGINES, "elsewhere", other)
    with pytest.raises(ValueError, match="elsewhere: .* m from the equations of motion"):
        simulated_seconds.made_ready("elsewhere", world)


@pytest.mark.parametrize("together", (1, COUNT))
def test_a_rollout_follows_our_simulator_in_mujoco_step_by_step(together, world):
    """The same bodies of the same model: each of their states is where our simulator in MuJoCo is at that time."""
    ours = ENGINES["MuJoCo fleet"].build(world)
    rolled = ByRollout(together, "RK4", world)
    ours.begin()
    rolled.fly(CHUNK)
    path = rolled._states[:, 3::4, 1 : 1 + 7 * together].reshape(-1, CHUNK, together, 7)[..., :3]
    for step in range(3):
        ours.fly(1)
        np.testing.assert_allclose(path[:, step].reshape(-1, 3), ours.positions(), atol=1e-4)


@pytest.mark.thorough  # JAX compiles for 20 s
def test_the_lines_of_the_physics_run_on_jax_with_all_their_terms():
    """Compiled, with delays on their way, they give what they give on numpy to the last bits."""
    jax = pytest.importorskip("jax", reason="jax is not installed: pip install 'auv_torchrl[bench]'")
    vehicle = load_vehicle("bluerov2_heavy").expand(COUNT)
    c = prepare(vehicle)
    c = c._replace(delay=c.delay + 0.07)
    rng, terms = np.random.default_rng(0), ActiveTerms.everything()
    level = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1))
    state = rest_state(np.zeros((COUNT, 3)), level, rng.uniform(-0.5, 0.5, (COUNT, 6)), vehicle.thrusters, memory=4)
    command = rng.uniform(-1.0, 1.0, (COUNT, vehicle.thrusters))
    with jax.enable_x64(True):
        known, there, given = jax.tree.map(jax.numpy.asarray, (c, state, command))
        step = jax.jit(lambda c, state, command: control_step(c, terms, state, command))
        for _ in range(5):
            state, there = control_step(c, terms, state, command), step(known, there, given)
    for ours, theirs in zip(state, there, strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-12)


def test_a_small_benchmark_has_a_row_of_every_engine_and_says_what_is_missing(monkeypatch):
    """Without JAX and stable-baselines3 their rows say what installs them, and all others have their figures."""
    there = extras.import_module

    def without(name):
        if name.startswith(("jax", "stable_baselines3")):
            raise ImportError(name)
        return there(name)

    monkeypatch.setattr(extras, "import_module", without)
    monkeypatch.setattr(simulated_seconds, "TIMED_S", 1e-3)
    few = {name: engines.Entry(own.build, own.precision, own.what, own.ours) for name, own in ENGINES.items()}
    monkeypatch.setattr(simulated_seconds, "ENGINES", few)
    monkeypatch.setattr(simulated_seconds, "MUST_TIMES_AT", COUNT)
    monkeypatch.setattr(simulated_seconds, "MUST_MUJOCO_AT", COUNT)
    found, missing = simulated_seconds.measure([COUNT], rounds=1)
    assert set(missing) == {name for name in ENGINES if "JAX" in name or "stable-baselines3" in name}
    lines = list(simulated_seconds.report(found, missing, [COUNT]))
    rows = {line.split(" | ")[0].removeprefix("| "): line for line in lines if line.startswith("| ")}
    assert set(rows) == {"engine", *ENGINES}
    for name in ENGINES:
        assert ("pip install 'auv_torchrl[bench]'" in rows[name]) == (name in missing)
        assert name in missing or found[name][COUNT].rate > 0
    assert sum("demanded" in line for line in lines) == 2
