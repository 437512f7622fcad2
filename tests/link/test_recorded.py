"""What the firmware said and wrote once, without the firmware: see ``recorded/README.md``."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from auv_torchrl.link.lockstep import Lockstep
from auv_torchrl.link.protocol import Servos, servo_packet
from auv_torchrl.paths import PROJECT
from benchmarks.trial.once import DOWN_M
from benchmarks.trial.recorded import FOLDER, UNIT, Recorder, messages, read_exchange, thinned, unpack

DIFFERS = 50  # units: the arithmetic of another machine over 40 s of flight
EVERY = 20  # frames of which one is compared


def test_a_real_exchange_is_answered_as_it_was(plant):
    """Each packet of the firmware from its first frame on, through arming and a dive to disarming."""
    servos, answers = read_exchange()
    vehicle = plant(down=DOWN_M, held=True)
    lockstep = Lockstep(vehicle, range(1, 9), paced=False)
    given = []
    for number, (rate, frame, *pwm) in enumerate(servos.tolist()):
        assert lockstep.answer(servo_packet(Servos(rate, frame, tuple(pwm))), "firmware")
        if number % EVERY == 0:
            given.append(np.hstack(vehicle.reading()))
    assert lockstep.counts == {"frame": len(servos)}
    assert len(servos) > 38_000 and np.ptp(answers[:, 7]) > 1.0  # it went some metres
    np.testing.assert_allclose(given, answers[::EVERY], rtol=0, atol=DIFFERS * UNIT)


def test_the_firmware_counts_up_and_comes_down_to_the_rate_that_is_set():
    """Frames one by one, 1200 Hz at first and 400 Hz in the end, motors off before arming."""
    servos, _ = read_exchange()
    assert (np.diff(servos[:, 1]) == 1).all() and servos[0, 1] == 0
    assert servos[0, 0] == 1200 and (np.diff(servos[:, 0]) >= -1).all() and servos[-1, 0] == 400
    assert set(servos[:4000, 2:8].ravel().tolist()) <= {0, 1500}


def test_a_fault_is_flown_diagnosed_and_cured(tmp_path):
    """The three commands of the document: the answer names the parameter, and behind it nothing is wrong any more."""
    environment = {**os.environ, "PYTHONPATH": str(PROJECT), "OMP_NUM_THREADS": "1"}

    def run(*line):
        done = subprocess.run(
            [sys.executable, "-m", *line], cwd=tmp_path, env=environment, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def diagnosed(number):
        given = ("--vehicle", "bluerov2_heavy", "--output", f"answer_{number}")
        run("auv_torchrl.monitoring.command", f"dives/dive_{number}.BIN", *given)
        return json.loads((tmp_path / f"answer_{number}" / "diagnosis.json").read_text())

    dive = ("benchmarks.trial.once", "dives", "--recorded")
    run(*dive, "--set", "MOT_1_DIRECTION=-1")
    first = diagnosed(1)
    assert first["verdict"] == "explained" and first["effects"][0]["thrusters"] == [1]
    assert (tmp_path / "answer_1" / "advice.param").read_text() == "MOT_1_DIRECTION,1\n"
    run(*dive, "--param", "answer_1/advice.param")
    assert diagnosed(2)["verdict"] == "no_gap"


def test_a_dive_that_is_not_recorded_is_refused(tmp_path):
    """With those that are."""
    with pytest.raises(ValueError, match=r"dive_1\.BIN of .*MOT_1_DIRECTION.*-1"):
        unpack("bluerov2_heavy", "swap", {}, tmp_path / "dive_1.BIN")
    assert not list(tmp_path.iterdir())


def test_an_exchange_is_kept_to_its_unit(plant, tmp_path):
    """Packets to the last bit, answers to 1e-5, whatever the motion."""
    vehicle, recorder, sent = plant({"current": {"north": 1.0}}, down=3.0), Recorder(), []
    answered = []
    for frame in range(200):
        servos = Servos(1200 - frame, frame, tuple(1100 + (7 * frame + 13 * n) % 800 for n in range(16)))
        vehicle.step([0.5, -0.5, 0.1, 0.0, 1.0, -1.0, 0.3, 0.2], 1 / 400)
        recorder.add(servo_packet(servos), vehicle.reading())
        sent.append((servos.rate_hz, servos.frame, *servos.pwm))
        answered.append(np.hstack(vehicle.reading()))
    recorder.write(tmp_path / "exchange")
    servos, answers = read_exchange(tmp_path / "exchange")
    assert (servos == np.array(sent)).all()
    np.testing.assert_allclose(answers, answered, rtol=0, atol=UNIT)


def test_a_thinned_log_keeps_what_it_is_asked_for(tmp_path):
    """Of a log of the firmware, byte by byte; a log with anything between its messages is refused."""
    unpack("bluerov2_heavy", None, {"MOT_1_DIRECTION": -1.0}, tmp_path / "dive_1.BIN")
    log = (tmp_path / "dive_1.BIN").read_bytes()
    everything = frozenset({name for name, _ in messages(log)})
    assert {"IMU", "RCOU", "PARM"} <= everything and thinned(log, everything) == log
    few = [name for name, _ in messages(thinned(log, frozenset({"RCOU"})))]
    assert few.count("RCOU") == [name for name, _ in messages(log)].count("RCOU") > 300 and set(few) == {"FMT", "RCOU"}
    with pytest.raises(ValueError, match="no message begins at byte 89"):
        thinned(log[:89] + b"?" + log[89:], everything)


def test_what_is_recorded_is_small():
    """Less than 300 kB for each file."""
    assert max(path.stat().st_size for path in FOLDER.iterdir()) < 300_000
