"""Commands that do not train read and compose their settings as Hydra would, without it."""

import shutil

import pytest
from hydra import compose as compose_by_hydra
from hydra import initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from auv_torchrl.command.compose import compose
from auv_torchrl.command.errors import BadInput
from auv_torchrl.command.overrides import OverrideError, read_override
from auv_torchrl.diagnosis.command import schema as diagnosis_schema
from auv_torchrl.export import schema as export_schema
from auv_torchrl.fly import schema as fly_schema
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.link import schema as link_schema
from auv_torchrl.paths import CONF, config_names

SCHEMAS = {**diagnosis_schema.SCHEMAS, **link_schema.SCHEMAS, **export_schema.SCHEMAS}
GROUPS = {"diagnose": (), "calibrate": (), "sim": ("scenario",), "export": ()}
LINES = [
    *(("diagnose", [f"vehicle={name}"]) for name in config_names("vehicle")),
    ("sim", [f"+scenario=[{','.join(config_names('scenario'))}]"]),
    ("sim", ["+scenario=weed"]),
    ("sim", ["+scenario=[swap,current,thruster_gain]", "start.down=2", "seed=3", "until_s=1e2"]),
    ("sim", ["+scenario.effects.current.north=0.2", "rerun=true", "outputs=[8,7,6,5,4,3,2,1]"]),
    ("calibrate", ["healthy=[a.csv, 'b c.csv']", "output=mine.yaml", "replace=true", "modes=[MANUAL]"]),
    ("diagnose", ["log='a, b.csv'", "params={MOT_1_DIRECTION: -1}", "diagnosis.window_s=3", "system=null"]),
    ("diagnose", ["vehicle.rigid_body.mass=12", "+vehicle.thrusters.volts=16", "++vehicle.coriolis=0", "jobs=-1"]),
    ("diagnose", ["~vehicle.rigid_body.mass", "vehicle.quadratic_drag=[1,2,3,4,5,6]", "log=${oc.env:HOME}/a.csv"]),
    ("diagnose", ["diagnosis.ignored=[current,payload]", "+diagnosis.scan={current: {north: {values: [0.2]}}}"]),
    ("export", ["policy=outputs/train/mine"]),
]


@pytest.fixture(scope="module")
def conf(tmp_path_factory):
    """What Hydra is to read: the same files without the text of --help, which it would take for a setting."""
    folder = tmp_path_factory.mktemp("hydra") / "conf"
    shutil.copytree(CONF, folder)
    for name in GROUPS:
        text = (folder / f"{name}.yaml").read_text()
        (folder / f"{name}.yaml").write_text(text[: text.index("\nhelp: ") + 1])
    return folder


def by_hydra(conf, name, overrides):
    """What Hydra composes."""
    for key, schema in SCHEMAS.items():
        ConfigStore.instance().store(key, schema)
    check_config_files()
    with initialize_config_dir(str(conf), version_base="1.3"):
        config = compose_by_hydra(name, overrides)
    OmegaConf.set_struct(config, False)
    return config


@pytest.mark.parametrize(("name", "overrides"), LINES, ids=str)
def test_settings_are_those_that_hydra_composes(conf, name, overrides):
    """All vehicles, all scenarios, and every way to set, add and remove a value."""
    composed = compose(name, overrides, SCHEMAS, GROUPS[name])
    assert OmegaConf.to_yaml(composed.config) == OmegaConf.to_yaml(by_hydra(conf, name, overrides))


@pytest.mark.parametrize(
    ("name", "line", "says"),
    [
        ("diagnose", "seed=3", "no config key 'seed': there are alike"),
        ("diagnose", "vehicle.rigid_body.mas=3", r"no config key 'mas' in vehicle.rigid_body: .*did you mean mass"),
        ("diagnose", "vehicle.thrusters.volts=16", r"leaves out vehicle.thrusters.volts: give \+vehicle"),
        ("diagnose", "vehicle=foo", "no vehicle named 'foo': there are ardusub_sitl"),
        ("diagnose", "vehicle=[paper]", "give the name of one"),
        ("diagnose", "+vehicle=paper", r"vehicle=\.\.\. without \+"),
        ("diagnose", "vehicle=null", "there are ardusub_sitl"),
        ("diagnose", "vehicle=paper,bluerov2", "is ambiguous"),
        ("diagnose", "reference=many", "reference.*could not be converted to Integer"),
        ("diagnose", "log=glob(*)", "is ambiguous"),
        ("diagnose", "jobs=a=b", "in quotes"),
        ("diagnose", "~lgo", "no config key 'lgo'"),
        ("diagnose", "hydra.run.dir=x", "no config key 'dir'|no config key 'hydra"),
        ("diagnose", "vehicle@x=paper", "no config key|without @"),
        ("sim", "scenario=swap", r"give \+scenario=swap"),
        ("sim", "+scenario=foo", "no scenario named 'foo'"),
        ("sim", "+scenario=[swap,foo]", "no scenario named 'foo'"),
        ("sim", "+scenaro=swap", "did you mean scenario"),
        ("sim", "+seed=3", "without +"),
    ],
)  # fmt: skip
def test_what_nothing_would_read_is_refused_in_one_line(name, line, says):
    """It names what there is."""
    with pytest.raises(BadInput, match=says.replace("without +", r"without \+")) as error:
        compose(name, [line], SCHEMAS, GROUPS[name])
    assert "\n" not in str(error.value)


def hydras(text):
    """Key, value and kind as Hydra reads an argument; None where it refuses."""
    try:
        parsed = OverridesParser.create().parse_override(text)
    except HydraException:
        return None
    value = parsed._value
    return parsed.key_or_group, parsed.is_sweep_override(), plain(value) if not parsed.is_sweep_override() else None


def plain(value):
    """Without Hydra's class of texts in quotes."""
    if isinstance(value, list):
        return [plain(entry) for entry in value]
    if isinstance(value, dict):
        return {plain(key): plain(entry) for key, entry in value.items()}
    return getattr(value, "text", value)


def ours(text):
    try:
        parsed = read_override(text)
    except OverrideError:
        return None
    return parsed.key, parsed.is_sweep, parsed.value if not parsed.is_sweep else None


PIECES = [
    "a", "b.csv", "1", "-2.5", "1e3", "007", "true", "Null", "inf", "'x, y'", '"q"', "'it\\'s'", "\\,", "\\\\", "[",
    "]",
    "{", "}", ":", ",", " ", "=", "${a}", "$", "/", "-", "+", "(", ")", "glob(*)", "*", "_", "é",
    "1_000", ".5", "5.", "'",
]  # fmt: skip


@given(st.lists(st.sampled_from(PIECES), max_size=7).map("".join))
def test_a_value_is_read_as_hydra_reads_it(text):
    """Words, numbers, texts in quotes, lists, mappings and nonsense."""
    mine, theirs = ours(f"key={text}"), hydras(f"key={text}")
    if theirs is None and mine is not None and mine[1]:
        return  # a function is left to Hydra
    assert mine == theirs or repr(mine) == repr(theirs)  # nan differs from itself


@pytest.mark.parametrize("key", ["a.b", "+a.b", "++a", "~a", "a/b", "+a@b", "a b", "", "1a", "a.0.b", "a-b", "~a.b"])
def test_a_key_is_read_as_hydra_reads_it(key):
    """Settings, groups, and what is none."""
    assert ours(f"{key}=1") == hydras(f"{key}=1")


def test_a_setting_that_is_called_as_a_folder_of_conf_is_a_setting():
    """``vehicle`` of auv-export and a task of auv-fly are values, for their files take nothing from these folders."""
    given = compose("export", ["vehicle=mine.yaml", "format=mjcf"], export_schema.SCHEMAS)
    assert given.config.vehicle == "mine.yaml" and not given.choices
    task = compose("fly", ["task={name: circle, radius_m: 2}"], fly_schema.SCHEMAS).config.task
    assert dict(task) == {"name": "circle", "radius_m": 2}
