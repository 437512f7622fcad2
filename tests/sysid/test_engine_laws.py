"""What holds of the engine whatever it is asked: known truths come back, and the mathematics is right."""

import numpy as np
import pytest
from scipy.stats import binom

from auv_torchrl.sysid import (
    Candidate,
    Channel,
    Disturbance,
    Hypothesis,
    LogRecord,
    Noise,
    Parameter,
    Prior,
    Problem,
    StepModel,
    chance,
    cut,
    identify,
    indistinguishable,
    intervals,
    is_explained,
    probabilities,
    smooth,
)
from auv_torchrl.sysid.fit import fit, least_quadratic, parameter_columns
from auv_torchrl.sysid.linear import linearise, reduced_quadratic
from auv_torchrl.sysid.trace import Outcome, Record, SearchTrace
from tests.sysid.cart import CANDIDATES, DISTURBANCE, NOISE, Cart, drive, windows_of

TRUTHS = [
    {"gain": -1.0},
    {"gain": 0.0},
    {"friction": 0.8},
    *(pytest.param(one, marks=pytest.mark.thorough) for one in ({"spring": 1.0}, {"offset": 0.2}, {"mass": 3.0})),
    {"mass": 3.0, "wind": 0.7},
    {"offset": 0.3, "spring": 1.0},
    {"drag": 2.5, "friction": 0.4},
]


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda truth: "+".join(truth))
def test_a_known_change_is_found_with_its_value_and_nothing_beside(truth):
    """Also reversed and dead drives, friction that sticks, a biased sensor, and two causes at once."""
    model = Cart()
    found = identify(model, windows_of(model, truth, seed=1), DISTURBANCE, CANDIDATES)
    assert found.best.names == tuple(sorted(truth))
    assert is_explained(found.best)
    for interval in intervals(found.best):
        true = truth[interval.parameter.name]
        assert abs(interval.value - true) < 2 * max(interval.high - interval.low, 0.02)
        assert interval.is_determined and not interval.at_bound


def test_a_sound_system_is_not_explained():
    """Of eight logs without a change none gets one."""
    model = Cart()
    named = [identify(model, windows_of(model, {}, seed), DISTURBANCE, CANDIDATES).best.names for seed in range(8)]
    assert named == [()] * 8


def test_what_is_outside_the_candidates_is_said_to_remain():
    """A spring, where no candidate is one, leaves more than noise and disturbance do."""
    model = Cart()
    windows, known = windows_of(model, {"spring": 3.0}, seed=3), [one for one in CANDIDATES if one.name != "spring"]
    best = identify(model, windows.with_noise(Noise.of(np.array(NOISE))), DISTURBANCE, known, known_noise=True).best
    assert not is_explained(best)
    assert chance(best) < 1e-3


def test_intervals_hold_the_truth_as_often_as_they_say():
    """Of 40 gains 95 % intervals hold about 38; a count that chance gives once in a thousand is refused."""
    model, inside = Cart(), 0
    for seed in range(40):
        truth = {"gain": float(np.random.default_rng(seed).uniform(0.2, 0.8))}
        windows = windows_of(model, truth, seed, seconds=8.0).with_noise(Noise.of(np.array(NOISE)))
        problem = smooth(Problem.of(model, windows, DISTURBANCE), model.nominal, known_noise=True)
        prior = Prior(model, Hypothesis((CANDIDATES[2],)))
        found = fit(problem.problem, prior, prior.begin(), problem.linear.path)
        (interval,) = intervals(found)
        inside += interval.low <= truth["gain"] <= interval.high
    assert binom.ppf(0.001, 40, 0.95) <= inside


def test_evidence_does_not_depend_on_units():
    """A log in millimetres gives the same hypothesis, and evidence ratios to a hundredth."""
    truth, found = {"friction": 0.8}, []
    for length in (1.0, 1e-3):
        model = Cart(length)
        scaled = [
            Candidate(
                one.name, {n: v / length if n in ("friction", "wind", "offset") else v for n, v in one.values.items()}
            )
            for one in CANDIDATES
        ]
        own = Disturbance(DISTURBANCE.size / length)
        found.append(identify(model, windows_of(model, {"friction": 0.8 / length}, 5), own, scaled))
    assert found[0].best.names == found[1].best.names == tuple(truth)
    gains = [one.best.log_evidence - one.fits[0].log_evidence for one in found]
    assert gains[0] == pytest.approx(gains[1], rel=1e-2)


def test_the_reduced_quadratic_is_the_full_one_with_starts_and_disturbances_at_their_best():
    """For random amounts it equals chi-square minimised over all free numbers of all windows."""
    model = Cart()
    problem = Problem.of(model, windows_of(model, {"gain": 0.6}, 2), DISTURBANCE)
    linear = linearise(problem, problem.simulate(model.nominal, problem.guess, problem.calm() + 0.1))
    prior, precision = Prior(model, Hypothesis()), problem.precision(DISTURBANCE.size)
    columns = parameter_columns(problem, prior, linear)
    quadratic = reduced_quadratic(problem, linear, columns, precision)
    away = problem.away(linear.path.start, linear.path.bins)
    for amounts in np.random.default_rng(0).normal(size=(5, columns.shape[2])):
        full = 0.0
        for window, slope in enumerate(linear.slope):
            left = linear.path.residual[window] - columns[window] @ amounts
            root = np.linalg.cholesky(precision).T
            rows, right = np.concatenate([slope, root]), np.concatenate([left, -root @ away[window]])
            full += np.linalg.lstsq(rows, right, rcond=None)[1].sum()
        reduced = quadratic.constant - 2 * quadratic.b @ amounts + amounts @ quadratic.A @ amounts
        assert reduced == pytest.approx(full, rel=1e-9)


def test_the_least_of_a_quadratic_within_bounds_is_no_higher_than_anywhere_else_there():
    """Against 2000 random points of the box, for random quadratics."""
    draw = np.random.default_rng(0)
    for _ in range(20):
        root = draw.normal(size=(4, 4))
        curvature, pull = root @ root.T + 0.1 * np.eye(4), draw.normal(size=4) * 3
        low, high = -draw.uniform(0, 1, 4), draw.uniform(0, 1, 4)
        found = least_quadratic(curvature, pull, low, high)
        assert ((found >= low - 1e-9) & (found <= high + 1e-9)).all()
        others = draw.uniform(low, high, size=(2000, 4))
        cost = np.einsum("ij,jk,ik->i", others, curvature, others) - 2 * others @ pull
        assert found @ curvature @ found - 2 * found @ pull <= cost.min() + 1e-9


def test_every_candidate_has_a_reason_and_probabilities_are_probabilities():
    """The trace answers "why not" for whatever was tried, and names what comes next."""
    model = Cart()
    found = identify(model, windows_of(model, {"gain": 0.4}, 4), DISTURBANCE, CANDIDATES)
    for candidate in CANDIDATES:
        assert "log units" in found.trace.why(candidate.name)
    with pytest.raises(KeyError, match="kraken"):
        found.trace.why("kraken")
    assert found.trace.runner_up is not None
    assert found.trace.best.names == ("gain",)
    assert all(-1e-9 <= share <= 1 + 1e-9 for share in probabilities(found.trace).values())
    assert "gain" in "\n".join(found.trace.table())


class Twins(Cart):
    """A cart on which wind and a slope of the rail are the same force."""

    def __init__(self):
        super().__init__()
        self.parameters = (*self.parameters, Parameter("slope", 0.0, -3.0, 3.0, "N"))

    def step(self, values, states, inputs, force):
        """The slope pushes as the wind does."""
        return super().step(values[:, :7], states, inputs, force + values[:, 7:])


def test_two_causes_of_one_force_are_indistinguishable():
    """Each has half of the probability, and both are declared."""
    model = Twins()
    candidates = [*CANDIDATES, Candidate("slope", {"slope": 0.5})]
    found = identify(model, windows_of(model, {"wind": 0.6}, 6), DISTURBANCE, candidates)
    assert set(indistinguishable(found.trace)) >= {("wind",), ("slope",)}
    assert probabilities(found.trace)["wind"] == pytest.approx(0.5, abs=0.1)


def test_single_wild_samples_are_outliers_and_change_nothing():
    """One sample in fifty is off by up to a metre, and the friction is found all the same."""
    model, draw = Cart(), np.random.default_rng(0)
    record = drive(model, {"friction": 0.8}, seed=7)
    values = record.values.copy()
    wild = draw.choice(len(values), len(values) // 50, replace=False)
    values[wild, 0] += draw.uniform(-1.0, 1.0, len(wild))
    windows = cut([LogRecord(record.inputs, record.times, values)], model.channels, model.dt, 40)
    found = identify(model, windows, DISTURBANCE, CANDIDATES)
    assert found.best.names == ("friction",)
    assert intervals(found.best)[0].value == pytest.approx(0.8, abs=0.1)


def test_errors_that_last_are_no_finding_where_the_noise_model_says_so():
    """A position that goes astray by centimetres for a second is noise, where it is known as such."""
    model, draw = Cart(), np.random.default_rng(0)
    record = drive(model, {}, seed=8)
    stray, now = np.zeros(len(record.values)), 0.0
    for row in range(len(stray)):
        now = now * np.exp(-0.05 / 1.0) + 0.03 * np.sqrt(1 - np.exp(-2 * 0.05)) * draw.normal()
        stray[row] = now
    values = record.values + np.stack([stray, np.zeros_like(stray)], axis=1)
    record = LogRecord(record.inputs, record.times, values)
    noise = Noise(np.array(NOISE), np.array([0.03, 0.0]), time=1.0)
    known = cut([record], model.channels, model.dt, 40, noise)
    found = identify(model, known, DISTURBANCE, CANDIDATES, known_noise=True)
    assert found.best.names == ()
    assert is_explained(found.best)
    white = cut([record], model.channels, model.dt, 40, Noise.of(np.array(NOISE)))
    assert not is_explained(identify(model, white, DISTURBANCE, (), known_noise=True).best)


class Wheel(StepModel):
    """A wheel that turns over again and again."""

    parameters = (Parameter("drag", 0.2, 0.0, 2.0, tolerance=0.002), Parameter("gain", 1.0, -1.5, 1.5))
    channels = (Channel("angle", "rad", angular=True),)
    dt, angles = 0.05, (0,)
    start_width, force_width = np.array([3.2, 20.0]), np.array([5.0])

    def step(self, values, states, inputs, force):
        """Euler's method; the angle is wrapped."""
        rate = states[:, 1] + self.dt * (values[:, 1] * inputs[:, 0] + force[:, 0] - values[:, 0] * states[:, 1])
        angle = np.remainder(states[:, 0] + self.dt * rate + np.pi, 2 * np.pi) - np.pi
        return np.stack([angle, rate], axis=-1)

    def observe(self, values, states):
        """The angle alone."""
        return states[..., :1] + 0.0 * values[:, :1, None]


def test_angles_that_turn_over_are_followed():
    """Half a gain is found of a wheel that turns over many times and is measured by its angle alone."""
    model, draw = Wheel(), np.random.default_rng(0)
    push = np.repeat(draw.normal(size=(30, 1)) * 6.0, 20, axis=0)
    states = model.simulate(
        model.changed({"gain": 0.5})[None], np.zeros((1, 1, 2)), push[None], np.zeros((1, 1, 600, 1))
    )
    angle = states[0, 0, :, :1] + draw.normal(size=(601, 1)) * 0.01
    assert (abs(np.diff(angle[:, 0])) > np.pi).sum() > 10
    windows = cut([LogRecord(push, np.arange(601) * model.dt, angle)], model.channels, model.dt, 20)
    tried = (Candidate("gain", {"gain": 0.0}), Candidate("drag", {"drag": 1.0}))
    found = identify(model, windows, Disturbance(np.array([0.05])), tried)
    assert found.best.names == ("gain",)
    assert intervals(found.best)[0].value == pytest.approx(0.5, abs=0.05)


def test_records_that_do_not_fit_are_refused_with_what_was_expected():
    """Too short ones, ones with other channels, and channels that never change."""
    model = Cart()
    record = drive(model, {}, 0)
    with pytest.raises(ValueError, match="give longer records or shorter windows"):
        cut([record], model.channels, model.dt, 4000)
    with pytest.raises(ValueError, match="expected"):
        cut([LogRecord(record.inputs, record.times, record.values[:, :1])], model.channels, model.dt, 40)
    still = LogRecord(record.inputs, record.times, record.values * (1.0, 0.0))
    with pytest.raises(ValueError, match="v never changes"):
        cut([still], model.channels, model.dt, 40)


@pytest.mark.parametrize("wrong", [{"nominal": 3.0}, {"high": 0.0, "nominal": 0.0}, {"tolerance": -1.0}], ids=str)
def test_a_parameter_that_cannot_be_fitted_is_refused_by_name(wrong):
    """A nominal value outside the bounds, bounds without room, and a negative tolerance."""
    given = {"name": "gain", "nominal": 1.0, "low": 0.0, "high": 2.0} | wrong
    with pytest.raises(ValueError, match="gain"):
        Parameter(**given)


def test_hypotheses_that_were_fitted_to_more_windows_are_weighed_by_them():
    """The likelier one of all windows is the likelier one of the trace, and no other record changes."""

    def record(name, evidence, outcome):
        return Record((name,), {}, evidence, 0.0, 1.0, "by a test", outcome)

    few = SearchTrace(
        (record("a", -10.0, Outcome.KEPT), record("b", -12.0, Outcome.BEATEN), record("c", -40.0, Outcome.PREDICTED))
    )
    whole = SearchTrace((record("a", -130.0, Outcome.STEP), record("b", -100.0, Outcome.KEPT)))
    again = few.weighed_again(whole)
    assert [one.log_evidence for one in again.records] == [-40.0, -10.0, -40.0]
    assert again.instead(("b",), Outcome.STEP).best.names == ("b",)


def test_what_was_taken_back_of_the_best_fit_is_said_so_and_nothing_is_ahead_of_it():
    """Changes of the best fit were taken back; all others are behind that fit, and not ahead of what is left."""

    def record(names, evidence, outcome):
        return Record(names, {}, evidence, 0.0, 1.0, "by a test", outcome)

    tried = SearchTrace(
        (
            record((), -900.0, Outcome.STEP),
            record(("a",), -300.0, Outcome.STEP),
            record(("a", "b"), -100.0, Outcome.KEPT),
            record(("a", "c"), -200.0, Outcome.BEATEN),
        )
    )
    assert tried.best_fit is tried.best
    left = tried.instead((), Outcome.REFUTED)
    assert left.best.outcome is Outcome.LEFT and left.best.names == () and left.best_fit.names == ("a", "b")
    assert left.why("b") == f"beside a it fits best; {Outcome.REFUTED.value}"
    assert left.why("c") == "beside a it is 100.0 log units behind, simulated"
