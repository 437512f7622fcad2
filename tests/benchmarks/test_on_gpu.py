"""What `make gpu` prints on a machine with a GPU, flown and trained small on the CPU."""

import pytest
import torch

from benchmarks.control import on_gpu

CPU = torch.device("cpu")
SHORT = {"stretch_steps": 80, "total_frames": 1, "evaluation_starts": 1, "num_envs": 4}


def test_the_tables_have_a_row_for_each_fleet_and_each_training(monkeypatch):
    """Fleets fly whole steps with resets, trainings end, and each is a row with numbers above zero."""
    flown, trained = on_gpu.steps_per_second, on_gpu.seconds_of_training
    monkeypatch.setattr(on_gpu, "AGENTS", ("gradient",))
    monkeypatch.setattr(on_gpu, "steps_per_second", lambda count, device: flown(count, device, 3, compiled=False))
    monkeypatch.setattr(on_gpu, "seconds_of_training", lambda *which: trained(*which, **SHORT))
    rows = [line.split("|")[1:-1] for line in on_gpu.table(CPU, (2, 4), seeds=1) if line.startswith("| ")]
    fleets = [row for row in rows if row[0].strip() in ("2", "4")]
    agents = [row for row in rows if row[0].strip() in on_gpu.AGENTS]
    assert len(fleets) == 2 and [row[0].strip() for row in agents] == list(on_gpu.AGENTS)
    assert all(float(row[3]) > 0 for row in agents)
    assert flown(4, CPU, 3, compiled=False) > 0


def test_without_a_gpu_it_says_what_to_do(monkeypatch, capsys):
    """The command ends with one line, not with a traceback of torch."""
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr("sys.argv", ["on_gpu"])
    with pytest.raises(SystemExit):
        on_gpu.main()
    assert "--device cpu" in capsys.readouterr().err
