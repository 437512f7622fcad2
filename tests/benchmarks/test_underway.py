"""A small version of the benchmark of vehicles at speed."""

import logging
import math
import sys
from functools import partial

import numpy as np
import pytest
import torch

from auv_torchrl.ddr import PretrainingConfig
from auv_torchrl.ddr.store import load_or_pretrain
from auv_torchrl.experiment import run
from auv_torchrl.vehicle import load_vehicle
from benchmarks import provenance
from benchmarks import published as tables
from benchmarks.published import SECTIONS
from benchmarks.underway import __main__ as command
from benchmarks.underway import control, dives, paths, turn
from benchmarks.underway.control import Errors, cells, fly_cases
from benchmarks.underway.dives import FAULTS, HEALTHY, Answer, ask, draw_fault

REMUS = load_vehicle("remus100")
TINY = (
    "starts=4", "task.episode_s=12", "agent.hidden=[8,8]", "agent.num_envs=4", "agent.steps_per_batch=5",
    "agent.stretch_steps=20", "agent.total_frames=160", "agent.evaluation_starts=2", "adapter.target_data_s=2",
    "flight.length_s=13.5", "flight.fault_s=[2,3]",
)  # fmt: skip


@pytest.mark.thorough
def test_every_row_of_the_table_is_flown(tmp_path, monkeypatch):
    """With a policy that has hardly been trained, and seconds of target data: all cases, in rows that may be there."""
    few = PretrainingConfig(transitions=1000, iterations=40)
    monkeypatch.setattr(run, "load_or_pretrain", partial(load_or_pretrain, config=few))
    flown = {case: errors for vehicle in control.SCENARIOS for case, errors in fly_cases(vehicle, 0, tmp_path, TINY)}
    assert flown.keys() == control.cases(tuple(control.SCENARIOS))
    assert all(math.isnan(errors.depth_m) == (case[0] != "remus100") for case, errors in flown.items())
    assert all(0 < errors.last_heading_rad < math.pi for errors in flown.values())
    text = "\n".join(control.report({case: [errors] for case, errors in flown.items()}))
    (table,) = tables.tables(text)
    sections = [SECTIONS["other-vehicles.md", name] for name in ("control", "control milliampere")]
    allowed = {row for section in sections for row in section.rows("")}
    assert {tuple(row[:3]) for row in table[1:]} == allowed


@pytest.mark.thorough
@pytest.mark.slow
def test_every_path_is_flown(tmp_path):
    """With a policy that has hardly been trained: rows that may be there, and no depth of a vessel at the surface."""
    flown = {}
    for vehicle in control.TOGETHER:
        flown |= paths.fly_paths(vehicle, 0, tmp_path, TINY, length_s=12.0)
    assert flown.keys() == paths.ROWS
    assert all(across.across_m > 0 for across in flown.values())
    assert all(math.isnan(across.depth_m) == (case[0] == "otter") for case, across in flown.items())
    (table,) = tables.tables("\n".join(paths.report({case: [across] for case, across in flown.items()})))
    assert {tuple(row[:2]) for row in table[1:]} == SECTIONS["other-vehicles.md", "paths"].rows("")


def test_distances_to_a_path_are_taken_from_above():
    """A vehicle 0.3 m beside it and 0.4 m below: 0.3 m across, and 0.4 m of depth where that is kept."""

    class Flown:
        time = torch.arange(301)[None] * 0.05
        position = torch.tensor([0.3, 0.0, 0.4]).expand(1, 301, 3)
        reference_position = torch.zeros(1, 301, 3)

    across = paths.Across.of(Flown(), dives=True)  # type: ignore[arg-type]
    assert across == pytest.approx((0.3, 0.3, 0.4))


def test_errors_are_those_of_the_end_and_of_all_that_counts():
    """A heading that falls from 0.4 to 0 rad at 25 of 30 s, and a depth that stays off by 0.1 m."""

    class Flown:
        time = torch.arange(601)[None] * 0.05
        position_error = torch.full((1, 601), 0.1)
        heading_error = torch.where(time < 25.0 - 1e-6, 0.4, 0.0)

    errors = Errors.of(Flown(), dives=True)  # type: ignore[arg-type]
    assert errors.depth_m == pytest.approx(0.1) and errors.last_depth_m == pytest.approx(0.1)
    assert errors.heading_rad == pytest.approx(0.3, abs=1e-3) and errors.last_heading_rad == 0.0
    afloat = Errors.of(Flown(), dives=False)  # type: ignore[arg-type]
    assert cells([afloat]) == ["–", "–", "17°", "0.0°"]
    assert cells([errors, errors._replace(depth_m=0.3)])[0] == "20 cm (10 to 30)"


def test_faults_are_of_fins_and_follow_from_the_seed():
    """The propeller is none; the same seed draws the same fault."""
    for kind in FAULTS:
        drawn = [draw_fault(REMUS, kind, np.random.default_rng(seed)) for seed in (0, 0, *range(20))]
        assert drawn[0] == drawn[1]
        assert {fin for fin, _ in drawn} == {2, 3, 4, 5}


@pytest.mark.slow
def test_a_dive_with_a_fault_of_a_fin_and_a_healthy_one_are_diagnosed():
    """A reversed fin is named, and nothing of a dive without a fault."""
    reversed_, healthy = ask(REMUS, "reversed", 0), ask(REMUS, HEALTHY, 0)
    assert reversed_.named and reversed_.servo and "fin_gain" in reversed_.said
    assert healthy.named and healthy.kind == HEALTHY


@pytest.mark.thorough
def test_a_servo_of_an_azimuth_thruster_is_named():
    """One that stands off its middle, and nothing beside."""
    ferry = load_vehicle("milliampere")
    drawn = [draw_fault(ferry, "stuck", np.random.default_rng(seed)) for seed in range(9)]
    assert {servo for servo, _ in drawn} == {3, 4}
    off = ask(ferry, "off its middle", 0)
    assert off.named and off.servo and off.said.startswith("azimuth_offset of ")


def test_a_dive_that_is_named_wrongly_counts_against_the_share():
    """Of two faults one; the fin alone is counted beside it."""
    answers = [Answer("stuck", False, True, ""), Answer("reversed", True, True, ""), Answer(HEALTHY, True, False, "")]
    text = "\n".join(dives.report(answers, 7))
    assert "| all faults | 2 | 50.0% (1/2, 9% to 91%) | 2/2 |" in text
    assert "| healthy | 1 | no gap: 1/1 |" in text and "seed 7" in text


def test_the_command_writes_its_sections_and_names_unknown_ones(tmp_path, monkeypatch, capsys):
    """What was measured stands between the marks of its part, with the command and the commit."""
    page = tmp_path / "other-vehicles.md"
    page.write_text("\n".join(SECTIONS["other-vehicles.md", "dives"].marks))
    monkeypatch.setattr(command, "PAGE", page)
    monkeypatch.setattr(dives, "ask", lambda vehicle, kind, seed: Answer(kind, True, True, ""))
    monkeypatch.setattr(command, "show_progress", lambda: logging.disable(logging.NOTSET))
    monkeypatch.setattr(provenance, "committed", lambda paths: "0123abc")
    monkeypatch.setattr(provenance, "age", lambda commit, paths: 0)
    monkeypatch.setattr(sys, "argv", ["underway", "dives", "--dives", "4", "--healthy", "1", "--publish"])
    command.main()
    assert "| all faults | 4 | 100.0%" in page.read_text()
    made = provenance.read_line(page.read_text())
    assert made is not None and made.command.endswith("dives --dives 4 --healthy 1 --seed 0")
    monkeypatch.setattr(sys, "argv", ["underway", "sails"])
    with pytest.raises(SystemExit):
        command.main()
    assert "no part named sails: there are control, paths, dives" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["underway", "paths", "--vehicle", "milliampere"])
    with pytest.raises(SystemExit):
        command.main()
    assert "vehicle milliampere has no table of paths" in capsys.readouterr().err


def test_the_rudder_that_is_left_ends_slow_turns():
    """A helm that has been told keeps 3 degrees with 0.08 rad/s; with 0.3 rad/s it overshoots."""
    found = turn.measure(starts=12, rates=(0.08, 0.3))
    slow, fast = (min(float(np.mean(found[rate, gain])) for gain in turn.GAINS) for rate in (0.08, 0.3))
    assert slow < math.radians(3.0) < fast
