"""The methods of the comparison, each a function of a scenario that flies and says what it took."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from torchrl.envs import TransformedEnv

from auv_torchrl.adaptation import InFlightAdapter, load_adaptation_config
from auv_torchrl.agents.config import AgentConfig, FineTuning, SACConfig, load_agent_config
from auv_torchrl.agents.pid import PID
from auv_torchrl.agents.policy import SourcePolicy
from auv_torchrl.baselines import (
    LQR,
    AdaptiveLQR,
    FixedSigns,
    HistoryPolicy,
    L1Augmentation,
    RecursiveLeastSquares,
    pulse_test,
    retrain,
    train_encoder,
    train_informed,
    weigh_particles,
)
from auv_torchrl.compensation.close import Closed, close
from auv_torchrl.compensation.diagnosed import Diagnosed
from auv_torchrl.compensation.excitation import Excitation
from auv_torchrl.compensation.target_log import fly_target_log
from auv_torchrl.ddr import AdapterConfig, DDRAdapter, adapt
from auv_torchrl.ddr.store import load_or_pretrain
from auv_torchrl.ddr.transform import observing
from auv_torchrl.diagnosis import diagnose
from auv_torchrl.envs import FleetEnv, make_fleet
from auv_torchrl.evaluation import draw_starts, fly
from auv_torchrl.flight import Flight
from auv_torchrl.scenario import Scenario
from auv_torchrl.tasks import StationKeeping, Task
from auv_torchrl.vehicle import Vehicle
from benchmarks.control.source import BACKEND, ranges, source_policy, training_s

BUDGET = Excitation(episodes=4, episode_s=15.0)  # of target data, for every method that learns before the judged flight
NEVER_SETTLED = 1e-9  # standard error of DDR's map: the dither stays on, for the flight is paid for
RETRAINING_FRAMES = 51_200  # transitions of a training for one scenario, a third of the source policy's
HISTORY_AGENT = ("gradient", {"total_frames": 307_200, "hidden": [128, 128]})  # twice conf/agent/gradient.yaml
HISTORY_RANGES = {"thruster_gain": {"gain": [-1.0, 1.7]}}
INTEGRAL = (0.5, 0.5, 0.5, 0.2)  # 1/(m s) and 1/(rad s)


@dataclass(frozen=True)
class Attempt:
    """What a method did in a scenario."""

    flight: Flight
    target_data_s: float = 0.0  # flown on the target before the judged flight
    compute_s: float = 0.0  # CPU time before the judged flight
    notes: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Bench:
    """One scenario with everything that methods need; they all fly the same starts."""

    vehicle: Vehicle
    scenario: Scenario
    policies: Path
    count: int
    source: SourcePolicy

    @property
    def policy(self) -> Any:
        """u_s."""
        return self.source.module

    @property
    def target(self) -> Vehicle:
        """The vehicle when every effect has begun, no batch."""
        return self.scenario.vehicle_at(self.vehicle, max((c.start_s for c in self.scenario.changes), default=0.0))

    def task(self, thruster_commands: bool = False) -> StationKeeping:
        """The judged task: 20 s from starts in ±1 m."""
        return replace(StationKeeping().for_evaluation(1.0), thruster_commands=thruster_commands)

    def fleet(self, count: int, thruster_commands: bool = False, task: Task | None = None) -> FleetEnv:
        """Target vehicles."""
        task = task or self.task(thruster_commands)
        return make_fleet(BACKEND, self.vehicle, task, count, scenario=self.scenario, seed=0)

    def fly(self, policy: Any, transform: Any = None, thruster_commands: bool = False) -> Flight:
        """The judged flight."""
        fleet: Any = self.fleet(self.count, thruster_commands)
        if transform is not None:
            fleet = TransformedEnv(fleet, transform)
        task = self.task()
        return fly(fleet, policy, draw_starts(task, self.count, seed=2023), task.steps)


def ddr(bench: Bench, kind: str) -> Attempt:
    """The paper's method: target data with dither, then a map fitted to all of it."""
    models = load_or_pretrain(bench.vehicle, bench.task(), bench.policies)
    thrusters = kind == "thrusters"
    task = replace(bench.task(thrusters), episode_s=BUDGET.episode_s)
    pairs = round(BUDGET.seconds / task.control_dt)
    config = AdapterConfig(map=kind, target_data_s=BUDGET.seconds, bag_least=pairs, tolerance=NEVER_SETTLED)
    began = time.process_time()
    fitted = adapt(lambda count: bench.fleet(count, task=task), bench.policy, models, config).adapter
    spent = time.process_time() - began
    adapter = DDRAdapter(models, config)
    adapter.load_state_dict(fitted.state_dict())
    return Attempt(bench.fly(bench.policy, adapter, thrusters), BUDGET.seconds, spent)


def online(bench: Bench) -> Attempt:
    """Learn the thrusters in flight."""
    adapter = InFlightAdapter(bench.vehicle, bench.task(), load_adaptation_config(), bench.count)
    return Attempt(bench.fly(bench.policy, observing(adapter, bench.task()), True))


def signs(bench: Bench) -> Attempt:
    """Pulse every thruster, correct its sign."""
    began = time.process_time()
    found = pulse_test(bench.fleet(1, True), bench.vehicle)
    spent = time.process_time() - began
    return Attempt(bench.fly(bench.policy, FixedSigns(bench.vehicle, found.signs), True), found.target_data_s, spent)


def particles(bench: Bench) -> Attempt:
    """Weigh vehicles of wide ranges by a flight of the target, train again around the likely ones."""
    began = time.process_time()
    task = replace(bench.task(), episode_s=BUDGET.episode_s)
    starts = draw_starts(task, BUDGET.episodes, seed=1)
    flight = fly(bench.fleet(BUDGET.episodes, task=task), bench.policy, starts, task.steps)
    prior = {**ranges("wide"), "thruster_gain": {"gain": [-1.5, 1.7]}}
    weighed = weigh_particles(bench.vehicle, prior, flight, task.control_dt)
    spent = time.process_time() - began
    policy = source_policy(bench.vehicle, bench.policies, weighed.ranges(), short())
    notes = {"effective_number": weighed.effective_number}
    return Attempt(bench.fly(policy.module), BUDGET.seconds, spent + training_s(policy), notes)


def diagnosed(bench: Bench) -> Attempt:
    """Log the target, diagnose it, put what was found into simulator and controller."""
    task = bench.task()
    flown = fly_target_log(
        lambda task, count: bench.fleet(count, task=task), bench.vehicle, task, BUDGET, bench.scenario.name
    )
    began = time.process_time()
    found = Diagnosed.of(diagnose(flown, bench.vehicle, vehicle_name="paper"), bench.vehicle)
    looked = time.process_time()
    closed = closing(bench, found)
    spent = time.process_time() - looked
    said = found.diagnosis
    assert said is not None
    notes = {
        "verdict": said.verdict.key,
        "summary": said.summary,
        "prediction_closed": said.gap.closed,
        "input_mappable": said.input_mappable,
        "tuned": closed.tuned,
        "rehearsed_m": {"before": closed.before_m, "mapped": closed.mapped_m, "tuned": closed.tuned_m},
    }
    flight = bench.fly(closed.policy.module, closed.adapter(), True)
    return Attempt(flight, BUDGET.seconds, looked - began + max(spent, tuning_s(closed)), notes)


def told(bench: Bench) -> Attempt:
    """As if the diagnosis were the truth: its map, and training on the target where the map is not enough."""
    truth = Scenario("told", tuple(replace(change, start_s=0.0) for change in bench.scenario.changes))
    closed = closing(bench, Diagnosed(bench.vehicle, truth, {}))
    notes = {"tuned": closed.tuned}
    return Attempt(bench.fly(closed.policy.module, closed.adapter(), True), 0.0, tuning_s(closed), notes)


def closing(bench: Bench, found: Diagnosed) -> Closed:
    """What is believed, put into simulator and controller."""
    agent = load_agent_config()
    return close(found, bench.source, StationKeeping(), 1.0, agent, FineTuning(), 0, BACKEND, bench.policies)


def tuning_s(closed: Closed) -> float:
    """CPU seconds of its training, if there was any."""
    return training_s(closed.policy) if closed.tuned else 0.0


def retrained(bench: Bench) -> Attempt:
    """Fly the target with u_s, which explores, and train it on by soft actor-critic as the transitions come."""
    agent = load_agent_config("sac")
    assert isinstance(agent, SACConfig)
    began = time.process_time()
    task = replace(bench.task(), episode_s=BUDGET.episode_s)
    found = retrain(bench.source, bench.fleet(BUDGET.episodes, task=task), BUDGET.seconds, agent)
    spent = time.process_time() - began
    return Attempt(bench.fly(found.policy), found.target_data_s, spent)


def history(bench: Bench) -> Attempt:
    """A policy that infers the gains of the thrusters from its last half second."""
    began = time.process_time()
    made = history_policy(bench.vehicle, bench.policies)
    spent = time.process_time() - began
    flight = bench.fly(made.policy.module, made.transform(), True)
    return Attempt(flight, 0.0, max(spent, training_s(made.policy)))


@cache
def history_policy(vehicle: Vehicle, store: Path) -> HistoryPolicy:
    """Trained once for all scenarios, over gains of thrusters that may be dead or reversed."""
    task = replace(StationKeeping(), thruster_commands=True)
    policy = train_informed(vehicle, task, load_agent_config(*HISTORY_AGENT), HISTORY_RANGES, 0, BACKEND, store)
    return train_encoder(policy, vehicle, task, HISTORY_RANGES, "torch")  # more vehicles than MuJoCo holds


def augmented(bench: Bench) -> Attempt:
    """Oppose what the source vehicle's equations do not explain."""
    return Attempt(bench.fly(bench.policy, L1Augmentation(bench.vehicle, bench.task(), bench.count), True))


def regulated(bench: Bench, adaptive: bool) -> Attempt:
    """The linear-quadratic regulator of the source vehicle, or of the vehicle that it estimates."""
    policy = LQR(bench.vehicle, bench.task())
    adaptation = AdaptiveLQR(bench.vehicle, bench.task(), bench.count) if adaptive else None
    return Attempt(bench.fly(policy, adaptation, adaptive))


def robust(bench: Bench) -> Attempt:
    """One policy trained over wide ranges of all effects that a vehicle may meet."""
    policy = source_policy(bench.vehicle, bench.policies, ranges("wide"))
    return Attempt(bench.fly(policy.module), 0.0, training_s(policy))


def short() -> AgentConfig:
    """A training for one scenario."""
    return load_agent_config(overrides={"total_frames": RETRAINING_FRAMES})


METHODS: dict[str, Callable[[Bench], Attempt]] = {
    "u_s": lambda b: Attempt(b.fly(b.policy)),
    "PID": lambda b: Attempt(b.fly(PID(b.task()))),
    "PID with integral": lambda b: Attempt(b.fly(PID(b.task(), integral=INTEGRAL))),
    "LQR": lambda b: regulated(b, adaptive=False),
    "adaptive LQR": lambda b: regulated(b, adaptive=True),
    "L1 augmentation": augmented,
    "pulse test, fixed signs": signs,
    "recursive least squares": lambda b: Attempt(
        b.fly(b.policy, RecursiveLeastSquares(b.vehicle, b.task(), b.count), True)
    ),
    "DDR, 4 channels": lambda b: ddr(b, "affine"),
    "DDR to the thrusters": lambda b: ddr(b, "thrusters"),
    "online, in flight": online,
    "diagnosed, then closed": diagnosed,
    "told the target (oracle)": told,
    "robust SAC": robust,
    "particle weights, trained again": particles,
    "SAC, trained on": retrained,
    "history-conditioned (RMA)": history,
}
