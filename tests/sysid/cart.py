"""A cart on a rail: a simulator of five lines with seven ways to be wrong, for tests of the engine."""

import numpy as np

from auv_torchrl.sysid import Candidate, Channel, Disturbance, LogRecord, Parameter, StepModel, Windows, cut

DISTURBANCE = Disturbance(np.array([0.05]))  # N
NOISE = (0.003, 0.01)  # m, m/s
BEGIN = {"mass": 3.0, "drag": 2.0, "gain": 0.5, "friction": 0.5, "wind": 0.5, "offset": 0.1, "spring": 0.5}
CANDIDATES = tuple(Candidate(name, {name: value}) for name, value in BEGIN.items())


class Cart(StepModel):
    """Position and speed of a cart that a commanded force pushes; ``length`` is the unit of length in m."""

    dt = 0.05

    def __init__(self, length: float = 1.0):
        one = 1.0 / length
        self.length = length
        self.parameters = (
            Parameter("mass", 2.0, 0.5, 8.0, "kg", tolerance=0.05),
            Parameter("drag", 1.0, 0.0, 6.0, "kg/s", tolerance=0.05),
            Parameter("gain", 1.0, -1.5, 2.0, tolerance=0.02),
            Parameter("friction", 0.0, 0.0, 3.0 * one, "N"),
            Parameter("wind", 0.0, -3.0 * one, 3.0 * one, "N"),
            Parameter("offset", 0.0, -one, one, "m/s"),
            Parameter("spring", 0.0, 0.0, 5.0, "N/m"),
        )
        self.channels = (Channel("x", "m"), Channel("v", "m/s"))
        self.start_width = np.array([10.0, 3.0]) * one
        self.force_width = np.array([5.0]) * one

    def step(self, values, states, inputs, force):
        """Five steps of Euler's method."""
        mass, drag, gain, friction, wind, _, spring = values.T
        x, v = states.T
        for _ in range(5):
            push = gain * inputs[:, 0] + force[:, 0] + wind - friction * np.tanh(v * self.length / 0.02)
            v = v + 0.01 * (push - drag * v - spring * x) / mass
            x = x + 0.01 * v
        return np.stack([x, v], axis=-1)

    def observe(self, values, states):
        """Position, and a speed that may be off."""
        seen = states.copy()
        seen[..., 1] += values[:, 5][:, None]
        return seen


def drive(model: Cart, truth: dict[str, float], seed: int, seconds: float = 30.0) -> LogRecord:
    """What a cart of other values logs under random pushes and a random disturbance."""
    draw, steps = np.random.default_rng(seed), round(seconds / model.dt)
    push = np.repeat(draw.normal(size=(steps // 20, 1)) * 3.0, 20, axis=0) / model.length
    force, now = np.zeros((1, 1, steps, 1)), 0.0
    for k in range(steps):
        now = now * np.exp(-model.dt) + 0.05 * np.sqrt(1 - np.exp(-2 * model.dt)) * draw.normal()
        force[..., k, 0] = now / model.length
    values = model.changed(truth)[None]
    seen = model.observe(values, model.simulate(values, np.zeros((1, 1, 2)), push[None], force))[0, 0]
    noise = draw.normal(size=seen.shape) * NOISE / model.length
    return LogRecord(push, np.arange(steps + 1) * model.dt, seen + noise)


def windows_of(model: Cart, truth: dict[str, float], seed: int, seconds: float = 30.0) -> Windows:
    """The same in windows of two seconds."""
    return cut([drive(model, truth, seed, seconds)], model.channels, model.dt, 40)
