"""A source policy is trained once for everything that shapes it."""

import errno
import json
import logging
import os
from dataclasses import fields, replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from tensordict import TensorDict
from tiny_training import RANDOMIZATION, TASK, tiny_config, train_tiny

from auv_torchrl.agents.config import AGENTS, load_agent_config
from auv_torchrl.agents.policy import PolicyError, fingerprint, load_policy, save_policy
from auv_torchrl.agents.storage import StorageError, digest
from auv_torchrl.agents.train_source import describe
from auv_torchrl.effects.effect import changed
from auv_torchrl.vehicle import load_vehicle


def test_second_call_loads_and_says_so(tmp_path, caplog):
    """The policy comes back the same without training, and the log says where from."""
    first = train_tiny(tmp_path)
    caplog.set_level(logging.INFO)
    second = train_tiny(tmp_path)
    assert "taken from" in caplog.text and "training" not in caplog.messages[-1]
    assert second.metadata == json.loads(json.dumps(first.metadata))
    (folder,) = tmp_path.glob("*/policy.json")
    kept = {path.name for path in folder.parent.iterdir()}
    assert kept == {"policy.json", "policy.safetensors", "progress.csv"}
    observation = TensorDict({"observation": torch.randn(20, len(TASK.observation_names))}, batch_size=[20])
    torch.testing.assert_close(
        first.module(observation.clone())["action"], second.module(observation.clone())["action"], rtol=0, atol=0
    )


def test_half_written_policy_does_not_count(tmp_path, monkeypatch):
    """A process that dies while it stores the policy leaves nothing that is taken for one."""

    def die(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr("auv_torchrl.agents.policy.json.dumps", die)
    key = "0123"
    with pytest.raises(OSError, match="disk full"):
        save_policy(_policy(tmp_path), tmp_path / key)
    assert not (tmp_path / key).exists()
    with pytest.raises(FileNotFoundError, match="train one first"):
        load_policy(tmp_path / key)


def _policy(folder):
    from auv_torchrl.agents.networks import make_policy
    from auv_torchrl.agents.policy import SourcePolicy

    network = {"observations": 5, "actions": 4, "hidden": [8]}
    return SourcePolicy(make_policy(**network), {"network": network})


def test_stored_policy_is_never_overwritten(tmp_path):
    """Saving where a policy is raises and leaves it."""
    save_policy(_policy(tmp_path), tmp_path / "a")
    before = (tmp_path / "a" / "policy.safetensors").read_bytes()
    with pytest.raises(FileExistsError, match="move it away"):
        save_policy(_policy(tmp_path), tmp_path / "a")
    assert (tmp_path / "a" / "policy.safetensors").read_bytes() == before


@pytest.mark.parametrize("name", ["policy.safetensors", "policy.json"])
def test_damaged_policy_is_an_error(tmp_path, name):
    """A damaged file is not trained over; the error says what to do."""
    save_policy(_policy(tmp_path), tmp_path / "a")
    path = tmp_path / "a" / name
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(ValueError, match="move the folder away"):
        load_policy(tmp_path / "a")


def _change(folder, kind):
    """Do to a kept policy what must not be taken for it."""
    weights, readable = folder / "policy.safetensors", folder / "policy.json"
    content, tensors = json.loads(readable.read_text()), load_file(weights)
    if kind == "negated":
        save_file({name: -tensor for name, tensor in tensors.items()}, weights)
    elif kind == "nan":
        save_file({name: tensor * float("nan") for name, tensor in tensors.items()}, weights)
    elif kind == "nan, with digest":
        tensors = {name: tensor * float("nan") for name, tensor in tensors.items()}
        save_file(tensors, weights)
        content.pop("digest")
        readable.write_text(json.dumps({"digest": digest(tensors, content), **content}))
    elif kind == "settings":
        readable.write_text(json.dumps({**content, "result": {"best_m": 0.0}}))
    elif kind == "no digest":
        content.pop("digest")
        readable.write_text(json.dumps(content))
    elif kind == "no json":
        readable.unlink()
    elif kind == "no weights":
        weights.unlink()
    else:
        readable.write_text({"list": "[]", "empty": "", "cut": readable.read_text()[:50]}[kind])


CHANGES = {
    "negated": "was changed", "nan": "was changed", "nan, with digest": "no finite numbers", "settings": "was changed",
    "no digest": "has no digest: it is of an earlier version", "no json": "policy.json is missing",
    "no weights": "policy.safetensors is missing", "list": "damaged", "empty": "damaged", "cut": "damaged",
}  # fmt: skip


@pytest.mark.parametrize("kind", CHANGES)
def test_a_policy_that_is_not_what_was_kept_is_refused(tmp_path, kind):
    """One line with the remedy, and the files stay as they are."""
    save_policy(_policy(tmp_path), tmp_path / "a")
    _change(tmp_path / "a", kind)
    before = {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()}
    with pytest.raises(PolicyError, match=f"{CHANGES[kind]}.*: move the folder away to train it again") as error:
        load_policy(tmp_path / "a")
    assert "\n" not in str(error.value) and str(tmp_path / "a") in str(error.value)
    assert {path.name: path.read_bytes() for path in (tmp_path / "a").iterdir()} == before


def test_a_sound_policy_of_another_training_is_refused(tmp_path):
    """A folder that was copied to the place of another one is not taken for it."""
    train_tiny(tmp_path / "one")
    train_tiny(tmp_path / "two", seed=6)
    (one,), (two,) = ([path.parent for path in (tmp_path / name).glob("*/policy.json")] for name in ("one", "two"))
    two.rename(one.parent / "other")
    one.rename(one.parent / "mine")
    (one.parent / "other").rename(one)
    with pytest.raises(PolicyError, match=f"of another training.*wanted is {one.name}"):
        train_tiny(tmp_path / "one")


def test_weights_that_are_no_numbers_are_not_kept(tmp_path):
    """A policy of NaN is refused before it is written."""
    policy = _policy(tmp_path)
    next(policy.module.parameters()).data.fill_(float("nan"))
    with pytest.raises(PolicyError, match="no finite numbers: it is not kept"):
        save_policy(policy, tmp_path / "a")
    assert not list(tmp_path.iterdir())


def _fails(monkeypatch, code, names):
    """Let every file of these names fail to open for writing, as on a full disk or in a read-only folder."""
    usual = Path.open

    def fail(self, mode="r", *rest, **more):
        if ("w" in mode) and any(name in self.name for name in names):
            raise OSError(code, os.strerror(code))
        return usual(self, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", fail)


@pytest.mark.parametrize(
    ("code", "names", "cause"),
    [
        (errno.EROFS, ("checkpoint", ".lock"), "Read-only file system"),
        (errno.ENOSPC, ("checkpoint",), "No space left on device"),
        (errno.ENOSPC, ("policy.",), "No space left on device"),
    ],
)
def test_a_store_that_cannot_hold_a_policy_says_so_and_loses_nothing(tmp_path, monkeypatch, code, names, cause):
    """One line with the remedy; when there is room again the same command goes on."""
    with monkeypatch.context() as failing:
        _fails(failing, code, names)
        with pytest.raises(
            StorageError, match=f"kept in .* \\({cause}\\): make room .*policies=DIR; .*goes on from there"
        ):
            train_tiny(tmp_path)
    assert not list(tmp_path.glob("*/policy.json")) and not list(tmp_path.glob("*/*.partial"))
    resumed = train_tiny(tmp_path)
    for one, other in zip(resumed.module.parameters(), train_tiny(tmp_path / "b").module.parameters(), strict=True):
        assert torch.equal(one, other)


def test_a_folder_that_is_read_only_still_gives_its_policy(tmp_path, monkeypatch):
    """What was trained before needs no writing."""
    train_tiny(tmp_path)
    _fails(monkeypatch, errno.EROFS, ("",))
    train_tiny(tmp_path)


def ingredients(**changes):
    usual = {
        "vehicle": load_vehicle("paper"), "task": TASK, "agent_config": tiny_config(),
        "randomization": RANDOMIZATION, "seed": 0, "backend": "torch",
    }  # fmt: skip
    return describe(**{**usual, **changes})


def other(value):
    """A different value that is still allowed."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return {"fused": "stock", "l1": "l2"}[value]
    if isinstance(value, tuple):
        return tuple(2 * number for number in value)
    return 2 * value if isinstance(value, int) else value / 2 if value else 0.1


SETTINGS = [(agent, entry.name) for agent in AGENTS for entry in fields(AGENTS[agent])]


@pytest.mark.parametrize(("agent", "name"), SETTINGS)
def test_every_setting_shapes_the_hash(agent, name):
    """Two trainings share a policy only if they would give the same one."""
    usual = tiny_config(agent)
    changed = replace(usual, **{name: other(getattr(usual, name))})
    assert fingerprint(ingredients(agent_config=changed)) != fingerprint(ingredients(agent_config=usual))


def test_everything_else_shapes_the_hash():
    """Vehicle numbers, task, randomization, seed and backend each change the hash."""
    vehicle = load_vehicle("paper")
    vehicle = vehicle.replace(mass=vehicle.mass + 1e-9)
    changes = [
        {"vehicle": vehicle}, {"task": replace(TASK, error_weight=2.0)}, {"randomization": None},
        {"randomization": {"added_mass": {"scale": [0.8, 1.3]}}}, {"seed": 1}, {"backend": "mujoco"},
    ]  # fmt: skip
    hashes = [fingerprint(ingredients())] + [fingerprint(ingredients(**change)) for change in changes]
    assert len(set(hashes)) == len(hashes)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"gama": 0.9}, "unknown settings.*gama.*there are.*gamma"),
        ({"gamma": 1.0}, "gamma is 1.0: give a number in"),
        ({"loss": "fast"}, "give fused or stock"),
        ({"batch_size": 0}, "batch_size is 0: give a whole number of 1 or more"),
        ({"hidden": []}, "hidden is"),
        ({"stretch_steps": 41}, "multiple of steps_per_batch"),
        ({"steps_per_batch": 1}, "steps_per_batch"),
        ({"tau": 0.0}, "tau is 0.0"),
    ],
    ids=str,
)
def test_impossible_settings_are_refused(settings, message):
    """The error names the setting, its value and what is allowed."""
    with pytest.raises(ValueError, match=message):
        load_agent_config("sac", settings)


def test_agents_are_never_taken_for_each_other():
    """Of all settings alike, each agent has a policy of its own."""
    assert len({fingerprint(ingredients(agent_config=tiny_config(agent))) for agent in AGENTS}) == len(AGENTS)


def test_unknown_agent_names_those_there_are():
    """A misspelt agent is answered with the list."""
    with pytest.raises(FileNotFoundError, match="there are.*sac"):
        load_agent_config("sax")


def test_what_a_vehicle_leaves_out_keeps_the_policies_that_it_had():
    """Propellers that turn it shape a policy where it says so; the volts of a log never do."""
    config = tiny_config()

    def key(vehicle):
        return fingerprint(describe(vehicle, TASK, config, RANDOMIZATION, 0, "torch"))

    plain = load_vehicle("paper")
    content = describe(plain, TASK, config, RANDOMIZATION, 0, "torch")["vehicle"]
    assert not {"reaction", "volts", "compass_per_load", "dvl_turn", "dvl_position"} & set(content)
    assert key(changed(plain, volts=torch.tensor(16.0))) == key(plain)
    assert key(changed(plain, reaction=torch.full((6,), 0.016))) != key(plain)
    assert key(changed(plain, dvl_turn=torch.tensor(0.1))) != key(plain)
