"""mujoco.sysid gets a fair chance: it finds what it has a number for, and its answers are judged like those of all."""

import numpy as np
import pytest

from auv_torchrl.vehicle import load_vehicle
from benchmarks import rows
from benchmarks.blind.flights.cases import Case
from benchmarks.blind.flights.fly import fly

for module in ("mujoco", "plotly", "tabulate"):  # mujoco.sysid imports the last two, of the extra `bench`
    pytest.importorskip(module)

from benchmarks.versus import fit as fitting  # noqa: E402
from benchmarks.versus import score  # noqa: E402
from benchmarks.versus.cases import VEHICLE, parted  # noqa: E402
from benchmarks.versus.judge import judge_fit, judge_ours  # noqa: E402
from benchmarks.versus.mujoco_model import MujocoModel  # noqa: E402
from benchmarks.versus.own_simulator import OwnSimulator, predict, with_values  # noqa: E402
from benchmarks.versus.windows import FIT_S, HELD_S, cut, wrapped  # noqa: E402

PAPER = load_vehicle(VEHICLE)
HOOKS = ("command_delay", "heading_bias", "position_scale")  # that flights in MuJoCo read


@pytest.fixture(scope="module")
def weak():
    """A log of three short episodes of a vehicle whose thruster is weak, and its label."""
    ((log, label),) = fly([Case(1, "single", ("thruster_gain",), episodes=3, episode_s=12.0)], PAPER, 8)
    return log, label


@pytest.fixture(scope="module", params=["mujoco", "own_simulator"])
def answered(request, weak):
    """The model and what its fit of all numbers, or of gains and mass, says of that log."""
    model = MujocoModel(VEHICLE) if request.param == "mujoco" else OwnSimulator(PAPER)
    if request.param == "mujoco":  # all of its numbers take 20 s
        model.free = [one for one in model.free if one.name.startswith(("thruster_gain", "hidden.mass", *HOOKS))]
    logged, held = parted(weak[0])
    return model, fitting.fit(model, cut(logged, FIT_S, FIT_S), cut(held, HELD_S, HELD_S))


def test_the_gain_of_a_thruster_is_found(weak, answered):
    """The gain that was flown is found, and held-out flight is predicted better than by the nominal vehicle."""
    ((name, true),) = weak[1]["values"]["thruster_gain"].items()
    found = {n["name"]: n["value"] for n in answered[1]["numbers"]}[f"thruster_gain.{name}"]
    assert found == pytest.approx(true, abs=0.1)
    assert answered[1]["after_m"] < 0.5 * answered[1]["before_m"]


def test_the_models_answer_alike():
    """A change of any number that has the library's name moves MuJoCo's flight as it moves ours."""
    ((log, _),) = fly([Case(1, "no_gap", episodes=2, episode_s=12.0)], PAPER, 1)
    windows, model = cut(log, HELD_S, HELD_S), MujocoModel(VEHICLE)
    begin = np.array([one.nominal for one in model.free])
    flown = []
    for change in (0.0, 0.1):
        for one in model.free:
            params = model.parameters()
            params.update_from_vector(begin + [change * one.size * (other.name == one.name) for other in model.free])
            own = {} if one.name.startswith("hidden") else {one.name: one.nominal + change * one.size}
            flown.append((model.predict(params, windows), predict(with_values(PAPER, own), windows)))
    for number, one in enumerate(model.free):
        before, after = flown[number], flown[number + len(model.free)]
        theirs, ours = (wrapped(after[side] - before[side]).ravel() for side in (0, 1))
        least = 0.5 if one.name.startswith(("current", "mass_offset")) else 0.7  # which act on less in MuJoCo
        assert one.name.startswith("hidden") or np.corrcoef(theirs, ours)[0, 1] > least, one.name


def test_the_rows_are_those_that_are_allowed(weak, answered):
    """Every row of the tables has a first cell that published.py allows for its command."""
    model, answer = answered
    silent = {"diagnosis": {"verdict": "no_gap", "effects": [], "candidates": [], "gap": {}, "indistinguishable": []}}
    ours = judge_ours("case_0001", weak[1], {**silent, "seconds": 1.0, "cpu_s": 1.0}, (0.1, 0.1), PAPER)
    fit = judge_fit("case_0001", weak[1], answer, PAPER)
    one = {score.OURS: [ours], score.MUJOCO: [fit], score.OWN: [fit]}
    allowed = rows.of_versus("python -m benchmarks.versus --cases 1 --seed 0")
    tables = score.tables(one, model.free, model.free)
    assert {(row[0],) for table in tables for row in table.rows} <= allowed
    assert ours.found is False


def test_a_number_that_is_not_sure_names_no_cause(weak, answered):
    """A departure within its interval is no answer, and of two causes both must come first."""
    ((name, true),) = weak[1]["values"]["thruster_gain"].items()

    def judged(half, **label):
        """The outcome where one gain is right and all else nominal, each with that interval."""
        numbers = [{**number, "value": number["nominal"], "half": half} for number in answered[1]["numbers"]]
        numbers = [{**n, "value": true} if n["name"] == f"thruster_gain.{name}" else n for n in numbers]
        return judge_fit("case_0001", {**weak[1], **label}, {**answered[1], "numbers": numbers}, PAPER)

    assert judged(0.01).found is True and judged(0.01).moved == 0 and judged(0.01).errors == (0.0,)
    assert judged(9.0).found is False and judged(9.0).found_unsure is True
    assert judged(None).found is False
    assert judged(0.01, effects=["thruster_gain", "coriolis"]).found is False
    assert judged(0.01, effects=[], values={}).found is False
    assert judged(0.01, outside="waves", effects=[]).found is None
