"""Every setting has a type and a range beside its field, and a value outside is refused in one line."""

import math
from dataclasses import fields
from pathlib import Path
from typing import Annotated, cast, get_args, get_type_hints

import pytest
import yaml
from hydra import compose, initialize_config_dir
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from auv_torchrl.adaptation import AdaptationConfig, load_adaptation_config
from auv_torchrl.agents.config import AGENTS, FineTuning, load_agent_config
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.ddr.config import AdapterConfig
from auv_torchrl.diagnosis.command.request import read_settings
from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.experiment import schema
from auv_torchrl.experiment.flight_config import FlightConfig
from auv_torchrl.experiment.setup import read_experiment
from auv_torchrl.paths import CONF, config_names
from auv_torchrl.settings import In, check
from auv_torchrl.tasks import StationKeeping
from auv_torchrl.vehicle import load_vehicle

FLIGHT = FlightConfig(fly=True, length_s=40.0, fault_s=(5.0, 15.0))
SOUND = [
    *map(load_agent_config, AGENTS), AdapterConfig(), load_adaptation_config(), StationKeeping(), FLIGHT, Excitation(),
    FineTuning(),
]  # fmt: skip
DIAGNOSIS = yaml.safe_load((CONF / "diagnosis" / "default.yaml").read_text(encoding="utf-8"))
DIAGNOSIS["scan"] = {"current": {"north": {"values": [0.2], "linear": True}}}
PAPER = load_vehicle("paper")


def numbers(settings) -> list[tuple[str, bool]]:
    """The names of the fields that are numbers or hold several, and whether they hold several."""
    hints = get_type_hints(type(settings))
    found = [(f.name, hints[f.name]) for f in fields(settings)]
    numeric = {int, float}
    return [(name, bool(numeric & set(get_args(hint)) and isinstance(getattr(settings, name), tuple)))
            for name, hint in found if hint in numeric or numeric & set(get_args(hint))]  # fmt: skip


CASES = [(settings, name, several) for settings in SOUND for name, several in numbers(settings)]


@pytest.mark.parametrize(("settings", "name", "several"), CASES)
def test_no_number_of_a_run_may_be_infinite_or_none_or_absurd(settings, name, several):
    """Each field refuses it by its name."""
    sound = {entry.name: getattr(settings, entry.name) for entry in fields(settings)}
    for bad in (math.nan, math.inf, -math.inf, True, "3", -1e30):
        with pytest.raises(ValueError, match=rf"\.{name} is .*: give "):
            type(settings)(**{**sound, name: (bad, bad) if several else bad})


@pytest.mark.parametrize(
    "kind", [*AGENTS.values(), AdapterConfig, AdaptationConfig, StationKeeping, FlightConfig, Settings]
)
def test_every_number_declares_its_range(kind):
    """Beside its type; a new field without one fails here."""
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if {int, float} & {hint, *get_args(hint)}:
            assert any(isinstance(part, In) for part in get_args(hint) if not isinstance(part, type)) or any(
                isinstance(rule, In) for part in get_args(hint) for rule in get_args(part)
            ), name


@given(
    low=st.integers(-5, 5),
    span=st.integers(1, 9),
    value=st.floats(-20, 20),
    ends=st.sampled_from(["[]", "[)", "(]", "()"]),
)
def test_an_interval_means_what_mathematics_means(low, span, value, ends):
    """Square brackets hold their end, round ones do not."""
    high = low + span
    inside = low < value < high or (value == low and ends[0] == "[") or (value == high and ends[1] == "]")
    assert (value in In(f"{ends[0]}{low}, {high}{ends[1]}")) == inside


def test_the_message_names_key_value_and_range():
    """One line with all three."""

    class Some:
        share: Annotated[float, In("[0, 1)")]

    with pytest.raises(ValueError, match=r"^some\.share is 1\.5: give a number in \[0, 1\)$"):
        check(Some, {"share": 1.5}, "some")


@pytest.mark.parametrize(
    ("override", "names"),
    [
        ("seed=-1", ["seed is -1", "0 or more"]),
        ("seed=99999999999999999999", ["seed"]),
        ("starts=0", ["starts is 0", "1 or more"]),
        ("starts=1000000000", ["starts", "at most"]),
        ("starts_seed=-3", ["starts_seed is -3"]),
        ("box_m=inf", ["box_m is inf", "above 0"]),
        ("box_m=nan", ["box_m is nan"]),
        ("task.control_dt=inf", ["task.control_dt is inf"]),
        ("task.near_m=[0.1,inf]", ["task.near_m", "entries"]),
        ("agent.batch_size=0", ["agent.batch_size is 0"]),
        ("agent.num_envs=1000000000", ["agent.num_envs", "at most"]),
        ("agent.target_entropy=inf", ["agent.target_entropy is inf"]),
        ("agent.alpha_init=inf", ["agent.alpha_init is inf"]),
        ("agent.learning_rate=inf", ["agent.learning_rate is inf"]),
        ("agent.random_frames=-5", ["agent.random_frames is -5"]),
        ("agent.evaluation_box_m=inf", ["agent.evaluation_box_m is inf", "null"]),
        ("agent.evaluation_box_m=0", ["agent.evaluation_box_m is 0"]),
        ("adapter.target_data_s=1e9", ["adapter.target_data_s", "at most"]),
        ("adapter.hidden=1000000000", ["adapter.hidden"]),
        ("adapter.seed=-1", ["adapter.seed is -1"]),
        ("adaptation.seed=-1", ["adaptation.seed is -1"]),
        ("flight.fault_s=[5,inf]", ["flight.fault_s"]),
        ("flight.fault_s=[5,6,7]", ["fault_s"]),
        ("excitation.seed=-1", ["excitation.seed is -1"]),
        ("tuning.critic_frames=-1", ["tuning.critic_frames is -1"]),
        ("randomization.added_mass.scale=[nan,1]", ["nan"]),
    ],
)  # fmt: skip
def test_train_refuses_settings_before_anything_is_flown(override, names):
    """Each with its key, the value and what to give."""
    schema.register()
    with pytest.raises(Exception) as refused, initialize_config_dir(version_base="1.3", config_dir=str(CONF)):
        read_experiment(compose("train", [override]), "nominal")
    for name in names:
        assert name in str(refused.value.__cause__ or "") + str(refused.value)


def changed(path: str, value) -> dict:
    """The default settings of a diagnosis with one entry changed or added."""
    content = OmegaConf.create(DIAGNOSIS)
    OmegaConf.update(content, path, value, merge=False, force_add=True)
    return cast(dict, OmegaConf.to_container(content))


@pytest.mark.parametrize(
    ("path", "value", "names"),
    [
        ("window_s", 0, ["diagnosis.window_s is 0", "0.5 or more"]),
        ("window_s", math.inf, ["diagnosis.window_s is inf"]),
        ("window_s", "long", ["diagnosis.window_s is 'long'", "a number"]),
        ("prior_none", 1, ["diagnosis.prior_none is 1", "(0, 1)"]),
        ("prior_none", 0, ["diagnosis.prior_none is 0", "(0, 1)"]),
        ("floor_force", [0.1] * 5, ["diagnosis.floor_force", "6 entries"]),
        ("floor_force", [0.1] * 5 + [0], ["diagnosis.floor_force"]),
        ("floor_force", 0.1, ["diagnosis.floor_force is 0.1", "6 entries"]),
        ("excess", math.nan, ["diagnosis.excess is nan"]),
        ("excess", -1, ["diagnosis.excess is -1"]),
        ("lead_s", -1, ["diagnosis.lead_s is -1"]),
        ("bin_s", 0, ["diagnosis.bin_s is 0"]),
        ("bin_s", 1.5, ["diagnosis.bin_s is 1.5", "window_s"]),
        ("tempering", 0, ["diagnosis.tempering is 0"]),
        ("tempering", 2, ["diagnosis.tempering is 2"]),
        ("ignored", ["curent"], ["diagnosis.ignored", "'curent'", "did you mean current"]),
        ("ignored", "current", ["diagnosis.ignored is 'current'", "a list"]),
        ("thresholds", ["dead_bnad"], ["diagnosis.thresholds", "did you mean dead_band"]),
        ("nuisance.gremlin", {"size": 1.0}, ["diagnosis.nuisance.gremlin", "no effect"]),
        ("nuisance.linear_drag", {"scal": 1.0}, ["diagnosis.nuisance.linear_drag", "did you mean scale"]),
        ("nuisance.linear_drag.scale", -0.1, ["diagnosis.nuisance.linear_drag.scale", "-0.1", "above 0"]),
        ("nuisance.linear_drag.scale", math.inf, ["diagnosis.nuisance.linear_drag.scale", "inf"]),
        ("nuisance", 3, ["diagnosis.nuisance is 3", "a mapping"]),
        ("scan.curent", {"north": {"values": [1.0]}}, ["diagnosis.scan.curent", "did you mean current"]),
        ("scan.current.nort", {"values": [1.0]}, ["diagnosis.scan.current", "did you mean north"]),
        ("scan.current.north", {"value": [1.0]}, ["diagnosis.scan.current.north", "did you mean values"]),
        ("scan.current.north.values", [200.0], ["diagnosis.scan.current.north.values has 200.0", "[-2, 2]"]),
        ("scan.current.north.values", [math.nan], ["diagnosis.scan.current.north.values"]),
        ("scan.current.north.values", [], ["diagnosis.scan.current.north.values", "entries"]),
        ("scan.current.north.linear", "often", ["diagnosis.scan.current.north.linear", "true or false"]),
        ("scan.tether.together", [{"nort": 1.0}], ["diagnosis.scan.tether.together", "did you mean north"]),
        ("scan.thruster_swap", {"command": {"values": [1.0]}}, ["diagnosis.scan.thruster_swap", "no parameter"]),
        ("widnow_s", 3, ["widnow_s", "did you mean window_s"]),
    ],
)
def test_a_diagnosis_refuses_settings_before_anything_is_simulated(path, value, names):
    """Each with its key, the value and what to give."""
    with pytest.raises(ValueError) as refused:
        read_settings(changed(path, value), PAPER)
    assert "\n" not in str(refused.value)
    for name in names:
        assert name in str(refused.value)


@pytest.mark.parametrize("vehicle", config_names("vehicle"))
@pytest.mark.parametrize("file", sorted((CONF / "diagnosis").glob("*.yaml")), ids=lambda path: path.stem)
def test_the_settings_that_are_shipped_hold_for_every_vehicle(file: Path, vehicle):
    """No file of conf/diagnosis is refused."""
    read_settings(yaml.safe_load(file.read_text(encoding="utf-8")), load_vehicle(vehicle))
