"""A training that was broken off ends as if it had not been."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tiny_training
import torch
from tiny_training import TASK, train_tiny

from auv_torchrl.agents.interrupt import Interrupted
from auv_torchrl.agents.score import Examiner
from auv_torchrl.agents.storage import CheckpointError, load_checkpoint, save_checkpoint
from auv_torchrl.agents.trainer import CHECKPOINT, Diverged, Trainer
from auv_torchrl.paths import PROJECT


def assert_same_policy(one, other):
    weights, others = one.module.state_dict(), other.module.state_dict()
    assert weights.keys() == others.keys()
    assert all(torch.equal(weights[key], others[key]) for key in weights)
    clocks = {"wall_s", "cpu_s", "frames_per_s"}
    for point, twin in zip(one.metadata["curve"], other.metadata["curve"], strict=True):
        assert {k: repr(v) for k, v in point.items() if k not in clocks} == {
            k: repr(v) for k, v in twin.items() if k not in clocks
        }


def interrupt_in_stretch(patch: pytest.MonkeyPatch, stretch: int, signum: int = signal.SIGINT) -> None:
    """Press Ctrl-C during the evaluation of some stretch."""
    examined = []
    fly = Examiner.__call__

    def fly_and_press(self, policy):
        examined.append(policy)
        if len(examined) == stretch:
            signal.raise_signal(signum)
        return fly(self, policy)

    patch.setattr(Examiner, "__call__", fly_and_press)


def test_killed_training_ends_like_an_unbroken_one(tmp_path):
    """Kill -9 in the middle of a stretch, then the same command: the same policy, bit for bit."""
    frames = 80 * 5
    program = [sys.executable, tiny_training.__file__, tmp_path / "broken", str(frames), "4"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": str(PROJECT)}
    killed = subprocess.run(program, env=environment, stderr=subprocess.DEVNULL)
    assert killed.returncode == -signal.SIGKILL
    assert list(tmp_path.glob(f"broken/*.training/{CHECKPOINT}")) and not list(tmp_path.glob("broken/*/policy.json"))
    resumed = train_tiny(tmp_path / "broken", total_frames=frames)
    assert_same_policy(resumed, train_tiny(tmp_path / "unbroken", total_frames=frames))


@pytest.mark.parametrize(
    "training",
    [
        pytest.param({"backend": "torch", "loss": "stock"}, marks=pytest.mark.thorough),
        pytest.param({"backend": "mujoco"}, marks=pytest.mark.thorough),
        {"agent": "gradient"},
        pytest.param({"agent": "td3"}, marks=pytest.mark.thorough),  # goes on as SAC does
        {"agent": "ppo"},
    ],
    ids=str,
)
def test_interrupted_training_ends_like_an_unbroken_one(tmp_path, training, monkeypatch):
    """Ctrl-C saves and says how to go on; going on gives the same policy, replay buffer wrapped or not."""
    unbroken = train_tiny(tmp_path / "unbroken", **training)
    for stretch in (1, 2):
        interrupt_in_stretch(monkeypatch, stretch)
        with pytest.raises(Interrupted, match="run the same command to go on"):
            train_tiny(tmp_path / f"broken_{stretch}", **training)
        assert_same_policy(train_tiny(tmp_path / f"broken_{stretch}", **training), unbroken)


def test_a_training_interrupted_in_its_last_stretch_is_found_finished(tmp_path, monkeypatch):
    """Ctrl-C ends that run too; the next one keeps the policy without another transition."""
    unbroken = train_tiny(tmp_path / "unbroken")
    interrupt_in_stretch(monkeypatch, len(unbroken.metadata["curve"]))
    with pytest.raises(Interrupted, match="stopped at 240 transitions .* run the same command to go on"):
        train_tiny(tmp_path / "broken")
    monkeypatch.setattr(Trainer, "_run_stretch", None)  # there is none left to run
    assert_same_policy(train_tiny(tmp_path / "broken"), unbroken)


def test_sigterm_saves_as_ctrl_c_does(tmp_path, monkeypatch):
    """The checkpoint is written, and the interrupt says which signal it was."""
    interrupt_in_stretch(monkeypatch, 1, signal.SIGTERM)
    with pytest.raises(Interrupted, match="run the same command to go on") as stopped:
        train_tiny(tmp_path)
    assert stopped.value.signum == signal.SIGTERM
    assert list(tmp_path.glob(f"*.training/{CHECKPOINT}"))


def test_seeds_differ_and_repeat(tmp_path):
    """The same seed gives the same policy, another seed another one."""
    one, again = (train_tiny(tmp_path / name, seed=1) for name in "ab")
    assert_same_policy(one, again)
    other = train_tiny(tmp_path / "a", seed=2)
    with pytest.raises(AssertionError):
        assert_same_policy(one, other)


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory) -> Path:
    """The store in which a training was interrupted."""
    folder = tmp_path_factory.mktemp("interrupted")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(Interrupted):
        interrupt_in_stretch(patch, 2)
        train_tiny(folder)
    return folder


@pytest.fixture
def broken_off(interrupted, tmp_path) -> Path:
    """The checkpoint of that training, in a store of the test's own."""
    shutil.copytree(interrupted, tmp_path, dirs_exist_ok=True)
    (checkpoint,) = tmp_path.glob(f"*.training/{CHECKPOINT}")
    return checkpoint


@pytest.mark.parametrize("damage", ["cut", "text", "empty", "foreign", "one byte", "no digest"])
def test_damaged_checkpoint_is_refused_and_kept(broken_off, tmp_path, damage):
    """The error names the file and the remedy, and the file stays as it is."""
    whole = broken_off.read_bytes()
    if damage == "foreign":
        torch.save({"weights": torch.zeros(3)}, broken_off)
    else:
        middle = len(whole) // 2
        changed = {"cut": whole[:middle], "text": b"not a checkpoint", "empty": b"", "no digest": whole[:-32]}
        changed["one byte"] = whole[:middle] + bytes([whole[middle] ^ 128]) + whole[middle + 1 :]
        broken_off.write_bytes(changed[damage])
    content = broken_off.read_bytes()
    with pytest.raises(CheckpointError, match="move it away to train from the beginning") as error:
        train_tiny(tmp_path)
    assert str(broken_off) in str(error.value)
    assert broken_off.read_bytes() == content


@pytest.mark.parametrize(
    "change", [lambda state: state.pop("best"), lambda state: state["updater"].clear()], ids=range(2)
)
def test_checkpoint_with_other_keys_is_refused_and_kept(broken_off, tmp_path, change):
    """A sound file that holds something else is an error with the remedy, not a training that goes on without it."""
    key = broken_off.parent.name.removesuffix(".training")
    state = load_checkpoint(broken_off, key)
    change(state)
    save_checkpoint(broken_off, key, state)
    content = broken_off.read_bytes()
    with pytest.raises(CheckpointError, match="does not fit this training.*move it away to train from the beginning"):
        train_tiny(tmp_path)
    assert broken_off.read_bytes() == content


def test_checkpoint_of_another_training_is_refused(broken_off, tmp_path, monkeypatch):
    """One that lies where that of another seed would: the error says so, and the checkpoint stays."""
    content = broken_off.read_bytes()
    interrupt_in_stretch(monkeypatch, 1)
    with pytest.raises(Interrupted):
        train_tiny(tmp_path / "other", seed=6)
    (other,) = (tmp_path / "other").glob(f"*.training/{CHECKPOINT}")
    shutil.copy(broken_off, other)
    with pytest.raises(CheckpointError, match="belongs to another training"):
        train_tiny(tmp_path / "other", seed=6)
    assert other.read_bytes() == content


def test_checkpoint_is_old_or_new_when_writing_fails(broken_off, tmp_path, monkeypatch):
    """A process that dies while it writes a checkpoint leaves the one before."""
    content = broken_off.read_bytes()

    def die(state, file):
        file.write(b"half of it")
        raise OSError("disk full")

    monkeypatch.setattr(torch, "save", die)
    with pytest.raises(OSError, match="disk full"):
        train_tiny(tmp_path)
    assert broken_off.read_bytes() == content


def test_stretches_of_any_length_are_complete(tmp_path):
    """Training ends with whole stretches, and stops early where it is told to."""
    policy = train_tiny(tmp_path, task=TASK, total_frames=161)
    assert [point["frames"] for point in policy.metadata["curve"]] == [80, 160, 240]
    stopped = train_tiny(tmp_path, total_frames=161, stop_below_m=100.0)
    assert [point["frames"] for point in stopped.metadata["curve"]] == [80]


def test_divergence_is_an_error_with_a_remedy(tmp_path):
    """A learning rate that blows up is named, and no policy is stored."""
    with pytest.raises(Diverged, match="agent.learning_rate"):
        train_tiny(tmp_path, learning_rate=1e30)
    assert not list(tmp_path.glob("*/policy.json"))


def test_training_leaves_the_callers_random_numbers_alone(tmp_path):
    """What the caller draws next does not depend on whether a policy was trained or loaded."""
    torch.manual_seed(11)
    expected = torch.rand(3)
    torch.manual_seed(11)
    train_tiny(tmp_path)
    assert torch.equal(torch.rand(3), expected)
