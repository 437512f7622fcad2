"""The compiled physics does what the written one does, and is there, whole and once, however it is come by."""

import logging
import os
import subprocess
import sys

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.files import say_not_kept
from auv_torchrl.physics import ActiveTerms, control_step, prepare
from auv_torchrl.physics.kernel import Steps, Targets, native
from auv_torchrl.physics.kernel.assembly import assembly
from auv_torchrl.physics.kernel.recorded import Variant, code_of
from auv_torchrl.physics.kernel.steps import traced_step
from auv_torchrl.physics.kernel.symbols import Tape
from auv_torchrl.physics.step import runge_kutta_step
from auv_torchrl.physics.thrusters import thrust_targets
from auv_torchrl.simulator import PlainSimulator, TorchArrays
from auv_torchrl.simulator.arrays import lengthened
from tests.uneven import UNEVEN, load_any

H = 0.001  # s; the strongest drag of the registry on the lightest hull diverges above 0.002
PARTS = 2
names = st.sampled_from(["paper", "bluerov2", "bluerov2_heavy", UNEVEN])
seeds = st.integers(0, 2**31 - 1)


def drawn_vehicles(name, effect, rows, rng):
    """Vehicles (rows,) with an effect of another strength each, the last one also without Coriolis terms and lag."""
    vehicle = load_any(name)
    parameters = effect.member_parameters(vehicle)
    values = {}
    for member, p in parameters.items():
        share, nominal = rng.random(rows), p.nominal_value(vehicle, member)
        value = nominal + share * ((p.high if p.high > nominal else p.low) - nominal)
        values[member] = np.round(value) if p.discrete else value
    if effect.name == "thruster_swap":
        values = {"command_1": np.full(rows, 2.0), "command_2": np.full(rows, 1.0)}
    changed = effect.apply(vehicle.expand(rows), values).clone()
    changed.lag[: rows - 1] += 0.2 * rng.random((rows - 1, 1))
    changed.coriolis[: rows - 1] = 1.0
    return changed


def drawn_flight(windows, rows, count, thrusters, rng):
    """Body, thrust, targets, time and force of windows and rows."""
    body = rng.normal(size=(windows, rows, 13))
    return (
        body,
        10 * rng.normal(size=(windows, rows, thrusters)),
        30 * rng.normal(size=(windows, rows, count, PARTS, thrusters)),
        60 * rng.random((windows, rows)),
        5 * rng.normal(size=(windows, rows, count, 6)),
    )


def written(c, terms, body, thrust, targets, time, force):
    """States (W, R, S + 1, 13) and thrust by the physics as it is written, on numpy."""
    rows = max(len(c.lag), *(array.shape[1] for array in (body, thrust, targets, time, force)))
    body = np.broadcast_to(body, (len(body), rows, 13))
    states = [body]
    for step in range(targets.shape[2]):
        for part in range(targets.shape[3]):
            body, thrust = runge_kutta_step(
                c, terms, body, thrust, targets[:, :, step, part], time, H, force[:, :, min(step, force.shape[2] - 1)]
            )
            time = time + H
        states.append(body)
    return np.stack(np.broadcast_arrays(*states), axis=2), thrust


def assert_equal(found, expected):
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours, np.broadcast_to(theirs, ours.shape), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
@given(name=names, seed=seeds, windows=st.integers(1, 9), rows=st.integers(2, 9))
@settings(max_examples=4)
def test_compiled_steps_are_the_written_ones(effect, name, seed, windows, rows):
    """Drawn vehicles with any effect, wherever and however they move, are where the written physics takes them."""
    rng = np.random.default_rng(seed)
    c = prepare(drawn_vehicles(name, effect, rows, rng)).numpy()
    flight = drawn_flight(windows, rows, 3, c.full_thrust.shape[-1], rng)
    vehicles = Steps(c, ActiveTerms.of(c), H)
    assert vehicles.compiled
    assert_equal(vehicles.run(*flight), written(c, ActiveTerms.of(c), *flight))


@given(
    name=names, seed=seeds, windows=st.integers(1, 9), rows=st.integers(1, 9), shared=st.tuples(*[st.booleans()] * 7)
)
@settings(max_examples=30)
def test_what_rows_share_is_read_once_for_all(name, seed, windows, rows, shared):
    """One vehicle, start, thrust, target, time or force for all rows is as good as copies of it, in any memory."""
    rng = np.random.default_rng(seed)
    vehicle = load_any(name)
    c = prepare(vehicle.expand(1 if shared[0] else rows)).numpy()
    body, thrust, targets, time, force = (
        np.asfortranarray(array[:, :1] if alone else array)
        for array, alone in zip(drawn_flight(windows, rows, 3, vehicle.thrusters, rng), shared[1:6], strict=True)
    )
    force = force[:, :, :1] if shared[6] else force
    found = Steps(c, ActiveTerms.of(c), H).run(body, thrust, targets, time, force)
    assert_equal(found, written(c, ActiveTerms.of(c), body, thrust, targets, time, force))


def test_a_wrong_shape_is_told():
    """Arrays that lack a step, a thruster or a vehicle end in an error that tells their shape."""
    vehicle = load_any("paper")
    c = prepare(vehicle.expand(3)).numpy()
    body, thrust, targets, time, force = drawn_flight(2, 3, 4, vehicle.thrusters, np.random.default_rng(0))
    run = Steps(c, ActiveTerms.of(c), H).run
    for wrong in (
        (body[..., :12], thrust, targets, time, force),
        (body, thrust[..., :2], targets, time, force),
        (body, thrust, targets, time, force[:, :, :2]),
        (body[:, :2], thrust, targets, time, force),
    ):
        with pytest.raises(ValueError, match="shape"):
            run(*wrong)


def test_nothing_to_run_is_run():
    """No window and no step give no state behind the first."""
    vehicle = load_any("paper")
    c = prepare(vehicle.expand(3)).numpy()
    body, thrust, targets, time, force = drawn_flight(2, 3, 4, vehicle.thrusters, np.random.default_rng(0))
    run = Steps(c, ActiveTerms.of(c), H).run
    states, later = run(body, thrust, targets[:, :, :0], time, force[:, :, :0])
    np.testing.assert_array_equal(states, body[:, :, None])
    np.testing.assert_array_equal(later, thrust)
    assert run(body[:0], thrust[:0], targets[:0], time[:0], force[:0])[0].shape == (0, 3, 5, 13)


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """A cache folder of one's own."""
    folder = tmp_path / "cache"
    monkeypatch.setattr(native, "cache_folder", lambda: folder)
    native._say_once.cache_clear()
    say_not_kept.cache_clear()
    return folder


def small_program():
    """The assembly of the step, and how often it was worked out."""
    shapes = tuple(field.shape[1:] for field in prepare(load_any("paper").expand(1)).numpy())
    asked = []

    def assembled():
        asked.append(1)
        return assembly(traced_step(shapes, Variant.SURFACE))

    return assembled, asked


def test_it_is_compiled_once(empty_cache):
    """What was compiled is found again; damaged, it is compiled again, and whole from then on."""
    assembled, asked = small_program()
    assert native.load("step", assembled) and native.load("step", assembled)
    assert len(asked) == 1
    (kept,) = empty_cache.glob("*.o")
    whole = kept.read_bytes()
    for damaged in (b"", whole[:-9], whole[:40] + b"\0" + whole[41:]):
        kept.write_bytes(damaged)
        assert native.load("step", assembled)
        assert kept.read_bytes() == whole


def test_where_nothing_can_be_kept_it_is_compiled_and_said(empty_cache, caplog):
    """A cache folder that cannot be made leaves the physics compiled, and one line in the log."""
    empty_cache.write_text("a file")
    assembled, _ = small_program()
    assert native.load("step", assembled) and native.load("step", assembled)
    assert [record.levelname for record in caplog.records].count("WARNING") == 1


def test_numpy_takes_over_and_says_so_once(empty_cache, monkeypatch, caplog):
    """Without LLVM the steps are the same, by numpy, and the log tells it once."""
    monkeypatch.setitem(sys.modules, "llvmlite", None)
    monkeypatch.setitem(sys.modules, "llvmlite.binding", None)
    native._fingerprint.cache_clear()
    code_of.cache_clear()
    try:
        vehicle = load_any("bluerov2")
        c = prepare(vehicle.expand(3)).numpy()
        flight = drawn_flight(2, 3, 4, vehicle.thrusters, np.random.default_rng(0))
        with caplog.at_level(logging.WARNING):
            vehicles = [Steps(c, ActiveTerms.of(c), H) for _ in range(2)]
        assert not vehicles[0].compiled
        assert len(caplog.records) == 1 and "numpy" in caplog.text
        assert_equal(vehicles[0].run(*flight), written(c, ActiveTerms.of(c), *flight))
    finally:
        code_of.cache_clear()


def test_numpy_is_taken_wherever_it_is_asked_for(monkeypatch):
    """The variable counts from the moment that it is set, although the same steps were compiled before."""
    c = prepare(load_any("paper").expand(1)).numpy()
    assert Steps(c, ActiveTerms.of(c), H).compiled
    monkeypatch.setenv(native.CHOICE, "numpy")
    assert not Steps(c, ActiveTerms.of(c), H).compiled


def test_processes_that_start_together_share_one_compilation(tmp_path):
    """Of two processes with an empty cache both run compiled code, and one file is left of it."""
    code = (
        "from auv_torchrl.physics import ActiveTerms, prepare;"
        "from auv_torchrl.physics.kernel import Steps;"
        "from auv_torchrl.vehicle import load_vehicle;"
        "c = prepare(load_vehicle('paper').expand(2)).numpy();"
        "assert Steps(c, ActiveTerms.of(c), 0.02).compiled"
    )
    home = {name: str(tmp_path) for name in ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA")}
    started = [subprocess.Popen([sys.executable, "-c", code], env={**os.environ, **home}) for _ in range(2)]
    assert [process.wait() for process in started] == [0, 0]
    assert len(list(tmp_path.rglob("*.o"))) == 1


def test_a_symbol_does_not_decide():
    """Physics that branches on a value cannot be traced, and says so instead of taking one branch for all."""
    number = Tape().inputs("speed", ())
    with pytest.raises(TypeError, match="where"):
        bool((number > 0.0).numbers[()])


@pytest.mark.parametrize(("dtype", "close"), [(None, 1e-12), (torch.float64, 1e-12), (torch.float32, 1e-4)])
@given(name=names, seed=seeds, delayed=st.booleans())
@settings(max_examples=8)
def test_a_simulator_goes_where_the_written_physics_goes(dtype, close, name, seed, delayed):
    """On numpy and on torch, in double and in single precision, also after vehicles were replaced in mid-flight."""
    rng = np.random.default_rng(seed)
    effects = [EFFECTS["command_delay" if delayed else "thruster_gain"], EFFECTS["payload"]]
    vehicles = [drawn_vehicles(name, effect, 5, rng) for effect in effects]
    arrays = None if dtype is None else TorchArrays(torch.device("cpu"), dtype)
    simulator = PlainSimulator(vehicles[0], 0.02, arrays=arrays)
    simulator.replace(torch.arange(5), vehicles[0])
    state = simulator.state._replace(quaternion=simulator.state.quaternion + 1.0)
    simulator.state, expected = state, state
    for step in range(6):
        if step == 3:
            rows = np.array([1, 4])
            simulator.replace(rows, vehicles[1][rows])
        command = simulator.arrays.native(torch.as_tensor(rng.uniform(-1, 1, (5, simulator.thrusters))))
        longer = simulator.state.commands.shape[-2]
        expected = expected._replace(commands=lengthened(expected.commands, longer))
        expected = control_step(simulator.coefficients, simulator.terms, expected, command, 0.02)
        simulator.step(command)
    for ours, theirs in zip(simulator.state, expected, strict=True):
        assert type(ours) is type(theirs) and ours.dtype == theirs.dtype
        np.testing.assert_allclose(np.asarray(ours), np.asarray(theirs), rtol=close, atol=close)


@pytest.mark.parametrize("name", ["paper", "bluerov2"])
def test_compiled_targets_are_the_written_ones(name):
    """Beyond the limits, within the dead band and between, and where a command is no number, so is the target."""
    rng = np.random.default_rng(0)
    c = prepare(EFFECTS["thrust_limit"].apply(load_any(name).expand(9), {}).clone()).numpy()
    commands = rng.uniform(-1.5, 1.5, (9, 1, c.limit.shape[-1])) * np.geomspace(0.01, 1.0, 9)[:, None, None]
    commands[3, 0, 1] = np.nan
    for parts in (c, c._replace(limit=0.4 * c.full_thrust, dead_band=0.2 * c.full_thrust)):
        terms = ActiveTerms.of(parts)
        found = Targets(commands.shape[-1])(parts, terms, commands, 0.05, 2)
        np.testing.assert_allclose(found, thrust_targets(parts, terms, commands, 0.05, 2), rtol=1e-15)


def test_a_simulator_is_differentiated_through():
    """Where a gradient is wanted, it flows through the steps."""
    simulator = PlainSimulator(
        load_any("paper").expand(2), 0.05, arrays=TorchArrays(torch.device("cpu"), torch.float64)
    )
    simulator.state = simulator.state._replace(quaternion=simulator.state.quaternion + 1.0)
    command = torch.full((2, simulator.thrusters), 0.5, dtype=torch.float64, requires_grad=True)
    simulator.step(command)
    (gradient,) = torch.autograd.grad(simulator.state.velocity.square().sum(), command)
    assert gradient.isfinite().all() and (gradient != 0).any()
