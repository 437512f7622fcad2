"""The compiled force on free bodies is the written one, stage by stage, and MuJoCo flies the same without it."""

from collections import namedtuple

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.physics import ActiveTerms, prepare
from auv_torchrl.physics.free_body import free_body_force
from auv_torchrl.physics.kernel import Forces, native, recorded
from auv_torchrl.physics.kernel.recorded import Variant
from auv_torchrl.physics.kinematics import normalise, rotation_matrix
from auv_torchrl.simulator.mujoco import MujocoSimulator
from tests.physics.test_kernel import drawn_vehicles, names, seeds
from tests.uneven import load_any

INERTIA = np.repeat((20.0, 0.5), 3)
FASTEST = 1e5
STAGES = 3


def drawn_bodies(rows, rng):
    """Arrays as MuJoCo has them: bodies anywhere, none of them lost."""
    return {
        "position": rng.normal(size=(rows, 7))[:, :3],
        "rate": rng.normal(size=(rows, 6)),
        "rotation": np.ascontiguousarray(rotation_matrix(normalise(rng.normal(size=(rows, 4)))).reshape(rows, 9)),
        "lost": np.zeros((rows, 1)),
        "body force": np.zeros((rows, 6)),
    }


def written(c, bodies, wrench):
    """Force (R, 6) and sanity (R,) by the physics as it is written."""
    rotation = bodies["rotation"].reshape(-1, 3, 3)
    terms = ActiveTerms.of(c)
    return free_body_force(c, terms, INERTIA, FASTEST, bodies["position"], bodies["rate"], rotation, wrench)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
@given(name=names, seed=seeds, rows=st.integers(2, 9), alone=st.booleans())
@settings(max_examples=4)
def test_compiled_forces_are_the_written_ones(effect, name, seed, rows, alone):
    """Of drawn vehicles with any effect, at each of the stages, wherever the bodies are by then."""
    rng = np.random.default_rng(seed)
    drawn = drawn_vehicles(name, effect, rows, rng)
    c = prepare(effect.apply(load_any(name).expand(rows), {}) if alone else drawn).numpy()
    bodies, wrench = drawn_bodies(rows, rng), 50 * rng.normal(size=(STAGES, rows, 6))
    forces = Forces(c, INERTIA, FASTEST, bodies)
    if not forces.compiled:
        assert ActiveTerms.of(c).surface  # where the push of thrusters hangs on where they are
        return
    call = forces.callback(wrench)
    for given_then in wrench:
        bodies["rate"][:] = rng.normal(size=(rows, 6))
        call(None, None)
        force, sane = written(c, bodies, given_then)
        assert sane.all() and not bodies["lost"].any()
        np.testing.assert_allclose(bodies["body force"], force, rtol=1e-12, atol=1e-12 * np.abs(force).max())


@pytest.mark.parametrize("name", ["paper", "bluerov2"])
def test_a_lost_body_is_told_and_alone(name):
    """A body beyond all speeds, or of no number, feels no force and stays lost; the others feel what they felt."""
    rng = np.random.default_rng(0)
    c, bodies = prepare(load_any(name).expand(5).clone()).numpy(), drawn_bodies(5, rng)
    wrench = 50 * rng.normal(size=(1, 5, 6))
    call = Forces(c, INERTIA, FASTEST, bodies).callback(wrench)
    call(None, None)
    before = bodies["body force"].copy()
    bodies["rate"][1], bodies["rate"][3] = 1e6, np.nan
    call(None, None)
    bodies["rate"][[1, 3]] = 0.0
    np.testing.assert_array_equal(bodies["lost"][:, 0], [0, 1, 0, 1, 0])
    np.testing.assert_array_equal(bodies["body force"][[1, 3]], 0.0)
    np.testing.assert_array_equal(bodies["body force"][[0, 2, 4]], before[[0, 2, 4]])
    call(None, None)
    np.testing.assert_array_equal(bodies["lost"][:, 0], [0, 1, 0, 1, 0])


def test_vehicles_with_nothing_out_of_line_take_the_short_way():
    """The paper's vehicle needs no coupled term, one with its mass off centre or a lag does."""
    c = prepare(load_any("paper").expand(2).clone()).numpy()
    assert Variant.of(c) is Variant.DIAGONAL
    assert Variant.of(c._replace(lag=c.lag + 0.1)) is Variant.DEEP
    assert Variant.of(prepare(load_any("bluerov2").expand(2)).numpy()) is Variant.DEEP


@pytest.mark.parametrize("term", [*ActiveTerms._fields, "cubic_drag"])
def test_a_term_of_the_motion_has_the_whole_step_also_where_nobody_has_named_it(term, monkeypatch):
    """Coriolis terms and what no step works out leave the small step; every other term, a new one too, needs more."""
    terms = namedtuple("terms", [*dict.fromkeys((*ActiveTerms._fields, term))])
    known = terms(*(name == term for name in terms._fields))
    monkeypatch.setattr(terms, "of", staticmethod(lambda c: known), raising=False)
    monkeypatch.setattr(recorded, "ActiveTerms", terms)
    small = term in ("coriolis", "routing", "curve", "sensing", "sensor_noise")
    by_name = {"surface": Variant.SURFACE, "fins": Variant.FINS, "azimuth": Variant.AZIMUTH}
    expected = Variant.DIAGONAL if small else by_name.get(term, Variant.DEEP)
    assert Variant.of(prepare(load_any("paper").expand(2)).numpy()) is expected


@pytest.mark.parametrize("effect", ["thruster_lag", "command_delay", "battery_sag", "payload", "current"])
def test_mujoco_flies_the_same_on_numpy(monkeypatch, effect):
    """Where numpy is asked for, vehicles go where the compiled force takes them, also with thrusts that change."""
    flown = []
    for choice in ("", "numpy"):
        monkeypatch.setenv(native.CHOICE, choice)
        rng = np.random.default_rng(0)
        simulator = MujocoSimulator(drawn_vehicles("paper", EFFECTS[effect], 5, rng), 0.05)
        simulator.place(torch.arange(5), np.zeros((5, 3)), np.tile([1.0, 0, 0, 0], (5, 1)), np.zeros((5, 6)))
        for _ in range(20):
            simulator.step(rng.uniform(-1, 1, (5, simulator.thrusters)))
        flown.append(simulator.state)
    for ours, theirs in zip(*flown, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-10)
