"""Whatever a log holds, the diagnosis gives an answer that can be written, or one line that says why not.

Logs that once broke it run with every test, a few random examples with ``make test-all``;
``python -m pytest tests/diagnosis/test_fuzz_diagnosis.py --damages 2000`` runs as many as one likes, drawn at random.
An example that fails is printed in full and can be run again alone.
"""

import json
import tempfile
import traceback
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import auv_torchrl
from auv_torchrl.diagnosis import diagnose
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.report.files import write_files
from auv_torchrl.diagnosis.verdict import from_json, to_json
from auv_torchrl.effects import EFFECTS
from auv_torchrl.flightlog import POSE, VELOCITY, FlightLogError, raw_columns, read_flightlog, write_columns
from auv_torchrl.vehicle import load_vehicle
from benchmarks.blind.flights.damages import DAMAGES, damaged
from tests.diagnosis.hostile import EDITS
from tests.flightlog.simulate import simulated_logs

PAPER = load_vehicle("paper")
FEW = 3  # examples with make test-all: some 40 s, most of them calibrations
CHANGES = ({}, {"thruster_gain": {"gain_4": 0.4}}, {"current": {"north": 0.2}, "heading_bias": {"angle": 0.2}})
AXES = (
    ("x", "y", "z", "yaw"), POSE + VELOCITY, ("u", "v", "w", "r"), POSE, VELOCITY, ("x", "y", "yaw"), ("z",), ("u",),
    ("yaw",), ("x", "y"), ("x", "y", "z", "yaw", "u", "v", "w", "r"),
)  # fmt: skip
EASY = ("thruster_gain", "current", "heading_bias", "command_delay")
OURS = Path(auv_torchrl.__file__).parent


@dataclass(frozen=True)
class Example:
    """What is done to a flight and how it is diagnosed."""

    flight: int
    seconds: float
    axes: tuple[str, ...]
    edits: tuple[str, ...]
    seed: int
    healthy: str  # "none", "sound" or "same"
    settings: dict
    tried: tuple[str, ...]  # effects that are not ignored: all of them take ten seconds


examples = st.builds(
    Example,
    flight=st.integers(0, len(CHANGES) - 1),
    seconds=st.sampled_from((6.0, 9.0)),
    axes=st.one_of(
        st.sampled_from(AXES), st.lists(st.sampled_from(POSE + VELOCITY), min_size=1, unique=True).map(tuple)
    ),
    edits=st.lists(st.sampled_from((*DAMAGES, *EDITS)), max_size=3).map(tuple),
    seed=st.integers(0, 999),
    healthy=st.sampled_from(("none", "none", "sound", "same")),
    settings=st.fixed_dictionaries(
        {},
        optional={
            "window_s": st.floats(0.3, 6.0),
            "lead_s": st.floats(0.0, 5.0),
            "bin_s": st.floats(0.05, 1.0),
            "prior_none": st.floats(0.01, 0.99),
            "excess": st.floats(1.01, 3.0),
            "tempering": st.floats(0.05, 1.0),
        },
    ),
    tried=st.one_of(st.lists(st.sampled_from(sorted(EFFECTS)), max_size=5, unique=True).map(tuple), st.just(EASY)),
)


@cache
def flown(seconds):
    """Columns of clean flights with everything measured, one for each of CHANGES."""
    return [raw_columns(log) for log in simulated_logs("paper", list(CHANGES), episodes=3, seconds=seconds, seed=1)]


def columns_of(example, edits):
    """The raw columns of an example after ``edits``; a damage that the columns do not allow is left out."""
    clean = flown(example.seconds)[example.flight]
    columns = {k: v for k, v in clean.items() if k not in POSE + VELOCITY or k in example.axes}
    rng = np.random.default_rng(example.seed)
    for name in edits:
        if not {"t", "episode"} <= set(columns) or not len(columns["t"]):
            break
        if name in EDITS:
            columns = EDITS[name](columns, rng)
        elif set(DAMAGES[name].axes) <= set(columns):
            columns, _ = damaged(columns, DAMAGES[name], rng)
    return columns


def check(example, folder):
    """Diagnose an example and demand that what comes of it is whole."""
    paths = {"log": write_columns(columns_of(example, example.edits), folder / "log.csv")}
    if example.healthy == "sound":
        paths["healthy"] = write_columns(columns_of(example, ()), folder / "healthy.csv")
    ignored = tuple(name for name in EFFECTS if name not in example.tried)
    how = replace(load_settings(), **example.settings, ignored=ignored)
    try:
        log = read_flightlog(paths["log"], PAPER)
        healthy = {"none": [], "same": [log]}.get(example.healthy)
        healthy = [read_flightlog(paths["healthy"], PAPER)] if healthy is None else healthy
        diagnosis = diagnose(log, PAPER, healthy, vehicle_name="paper", settings=how)
    except FlightLogError as error:
        assert is_one_line(error)
        return
    except ValueError as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        meant = Path(where.filename).is_relative_to(OURS) and (where.line or "").startswith("raise ")
        if not (meant and is_one_line(error)):
            raise
        return
    content = to_json(diagnosis)
    assert from_json(json.loads(json.dumps(content, allow_nan=False))).verdict is diagnosis.verdict
    told = [*diagnosis.candidates, *diagnosis.effects]
    assert all(0.0 <= entry.probability <= 1.0 for entry in told)
    assert not {effect.name for effect in diagnosis.effects} & set(how.ignored or ())
    assert all(path.exists() for path in write_files(diagnosis, PAPER, folder / "diagnosis"))


def is_one_line(error):
    """Whether an error says something, in one line."""
    return bool(str(error)) and "\n" not in str(error)


BROKE = {  # logs on which the diagnosis once crashed
    "no effect to try": Example(0, 6.0, AXES[0], (), 0, "none", {}, ()),
    "no window can be followed": Example(2, 9.0, AXES[1], (), 0, "none", {}, ()),
    "windows shorter than a block": Example(0, 6.0, ("z",), (), 0, "none", {"window_s": 0.3}, ()),
    "nothing measured that moves": Example(1, 9.0, ("q",), (), 0, "none", {}, ()),
    "a dead thruster that may not be called so": Example(
        0, 6.0, VELOCITY, ("depth_zero", "commands_saturated"), 0, "none",
        {"window_s": 0.3, "excess": 1.01, "bin_s": 0.5288302374633281, "tempering": 0.4236560473093102,
         "prior_none": 0.01, "lead_s": 0.0}, ("added_mass", "thrust_limit"),
    ),
    "nothing moves, exactly": Example(2, 6.0, AXES[1], ("motionless",), 728, "same", {}, ()),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKE)
def test_logs_that_once_broke_the_diagnosis(name, tmp_path):
    """They give an answer, or one line."""
    check(BROKE[name], tmp_path)


@pytest.mark.thorough
@pytest.mark.timeout(0)
def test_any_log_gives_a_diagnosis_or_one_line(request):
    """Damaged and hostile logs, with any axes and settings: a whole answer, or a refusal that people can read."""
    wanted = request.config.getoption("--damages")

    @settings(
        max_examples=wanted or FEW, deadline=None, derandomize=wanted is None, database=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large], print_blob=True,
        phases=[Phase.generate] if wanted is None else [Phase.generate, Phase.shrink],
    )  # fmt: skip
    @given(examples)
    def holds(example):
        with tempfile.TemporaryDirectory() as folder:
            check(example, Path(folder))

    holds()
