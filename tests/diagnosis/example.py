"""A diagnosis whose numbers are known because they are written here; its curves are simulated."""

from dataclasses import replace
from functools import cache

import numpy as np

from auv_torchrl.diagnosis.verdict import (
    Alternative,
    Confirmation,
    Diagnosis,
    EffectProbability,
    Errors,
    Estimate,
    FoundEffect,
    Gap,
    NextExperiment,
    Regime,
    Trajectory,
    Verdict,
    Where,
    Window,
)
from auv_torchrl.effects import EFFECTS
from auv_torchrl.effects.advice import Advice
from auv_torchrl.flightlog import Finding, Severity
from tests.flightlog.simulate import simulated_logs

GAIN = {"thruster_gain": {"gain_4": 0.55}}


DRAG = {"linear_drag": {"scale_surge": 3.0}, "current": {"north": 0.3}}


@cache
def windows(name="paper", change="gain", seconds=5.0, velocity=False) -> tuple[Window, ...]:
    """Windows in which the vehicle has a change, and the simulator has not and then has."""
    change = {"gain": GAIN, "drag": DRAG, "none": {}}[change]
    options = {"episodes": 3, "seconds": seconds}
    measured = simulated_logs(name, [change], **options)[0]
    before, after = (simulated_logs(name, [c], noise=(0, 0), **options)[0] for c in ({}, change))

    def trajectory(episode):
        return Trajectory(episode.pose, episode.velocity)

    def seen(episode):
        pose = episode.pose.copy()
        pose[:, 3:5] = np.nan
        return Trajectory(pose, episode.velocity if velocity else np.full_like(pose, np.nan))

    return tuple(
        Window(m.number, m.t, m.commands, seen(m), trajectory(b), trajectory(a))
        for m, b, a in zip(measured.episodes, before.episodes, after.episodes, strict=True)
    )


def example() -> Diagnosis:
    """One thruster at reduced gain."""
    gain = Estimate(0.552, 0.541, 0.563, 1.0, "1")
    ranked = ["thruster_gain", "unknown", *(name for name in EFFECTS if name != "thruster_gain"), "none"]
    t = np.arange(0, 20, 0.05)
    return Diagnosis(
        log="flight.csv",
        vehicle="paper",
        verdict=Verdict.EXPLAINED,
        summary="Thruster 4 gives 55 % of its thrust; with that in the simulator, 97 % of the gap is gone.",
        where=Where(
            dof={"surge": 0.31, "sway": 0.27, "heave": 0.02, "yaw": 0.40},
            origin={"actuation": 0.93, "body": 0.01, "flow": 0.04, "external": 0.01, "sensing": 0.01},
            thruster={"1": 0.02, "2": 0.03, "3": 0.02, "4": 0.91, "5": 0.01, "6": 0.01},
            regime=(Regime("thruster 4 above half of its command", 2.3), Regime("turning to port", 1.7)),
        ),
        effects=(
            FoundEffect(
                "thruster_gain",
                0.993,
                {"gain_4": gain},
                (4,),
                0.97,
                "Thruster 4 gives 0.55 times its nominal thrust.",
                advice=(Advice("set MOT_4_DIRECTION to 1", {"MOT_4_DIRECTION": 1.0}), Advice("look for weed")),
            ),
        ),
        candidates=tuple(EffectProbability(n, p, p) for n, p in zip(ranked, _falling(len(ranked)), strict=True)),
        indistinguishable=(("thruster_gain of 4", "thrust_limit of 4"),),
        next_experiment=NextExperiment(
            "Pulses of thruster 4 at rising command would tell a lower gain from a lower limit.",
            t=t,
            thruster_commands=np.sin(t[:, None] * np.arange(1, 7)),
        ),
        gap=Gap(
            horizon_s=(0.5, 1.0, 2.0, 5.0),
            position_m=Errors((0.02, 0.06, 0.15, 0.43), (0.004, 0.006, 0.009, 0.018), (0.003, 0.004, 0.006, 0.011)),
            yaw_rad=Errors((0.05, 0.13, 0.31, 0.72), (0.006, 0.009, 0.013, 0.03), (0.005, 0.007, 0.01, 0.02)),
            dof={"surge": Errors((0.01, 0.03, 0.1, 0.3), (0.003, 0.004, 0.006, 0.01), (0.002, 0.003, 0.004, 0.008))},
            closed=0.97,
            held_out_episodes=(2, 5),
            confirmed=Confirmation(
                position_m=Errors((0.02, 0.06, 0.16, 0.44), (0.004, 0.006, 0.01, 0.019), (0.003, 0.004, 0.006, 0.011)),
                dof={"yaw": Errors((0.1, 0.2, 0.3, 0.4), (0.01, 0.01, 0.02, 0.02), (0.01, 0.01, 0.01, 0.01))},
                closed=0.96,
            ),
        ),
        input_mappable=0.95,
        detectable={"thruster_gain": Estimate(0.03, 0.02, 0.05, 1.0, "1")},
        detectable_with={6: {"thruster_gain": Estimate(0.02, 0.01, 0.03, 1.0, "1")}},
        cannot_tell=("roll and pitch are not measured",),
        findings=(
            Finding(Severity.WARNING, "gap", "1.20 s without data; the log is cut there", "Log on", ("t",), (9, 10)),
        ),
        headline="Thruster 4 gives 0.55 times its nominal thrust.",
        alternatives=(Alternative(("thruster_gain",), "", 0.99), Alternative((), "something unknown", 0.01)),
        windows=windows(),
    )


def no_gap() -> Diagnosis:
    """A healthy vehicle: no effects, no closed share, nothing to fly."""
    return replace(
        example(),
        verdict=Verdict.NO_GAP,
        summary="The vehicle does what the simulator says.",
        headline="No gap.",
        alternatives=(Alternative((), "", 1.0),),
        where=Where(),
        effects=(),
        indistinguishable=(),
        next_experiment=None,
        gap=replace(example().gap, closed=None, confirmed=None),
        input_mappable=None,
        cannot_tell=(),
        findings=(),
        windows=windows(change="none"),
    )


def hydrodynamic() -> Diagnosis:
    """A heavy vehicle with velocities in its log, an effect without a thruster, and a part left unexplained."""
    scale = Estimate(2.9, 2.6, 3.2, 1.0, "1")
    velocity = Errors((0.03, 0.05, 0.06, 0.07), (0.02, 0.02, 0.025, 0.03), (0.01, 0.01, 0.01, 0.011))
    return replace(
        example(),
        vehicle="bluerov2_heavy",
        verdict=Verdict.PARTLY_EXPLAINED,
        summary="Drag in surge is 2.9 times what the simulator assumes; a part of the gap stays unexplained.",
        effects=(
            FoundEffect("linear_drag", 0.91, {"scale_surge": scale}, (), 0.6, "The linear drag in surge is 2.9 times."),
            FoundEffect(
                "current", 0.88,
                {n: Estimate(v, v - 0.02, v + 0.02, 0.0, "m/s") for n, v in (("north", 0.3), ("east", 0.01))},
                (), 0.2, "The water moves north at +0.30 m/s.",
            ),
        ),
        where=replace(example().where, onset_s=42.0),
        gap=replace(example().gap, position_m=None, yaw_rad=None, velocity=velocity, closed=0.71),
        windows=windows("bluerov2_heavy", "drag", velocity=True),
    )  # fmt: skip


def _falling(count: int) -> list[float]:
    weight = np.exp(-2.5 * np.arange(count))
    return (weight / weight.sum()).tolist()
