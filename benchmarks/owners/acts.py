"""What happens to commands on their way: thrusters that push otherwise than commanded, and exchanged plugs."""

from typing import Any

import numpy as np
from typing_extensions import override

from benchmarks.blind.flights.outside import Outside
from benchmarks.blind.flights.plant import Influences, Motion

REST_S, RUN_S = (1.0, 6.0), (1.0, 6.0)  # how long a loose plug is off and on, on average: a bout is one stick movement


class OneThruster(Outside):
    """Base: one thruster, any of them, is at fault."""

    @override
    def draw(self) -> None:
        self.which = int(self.rng.integers(self.thrusters))
        self.size()

    def size(self) -> None:
        """Draw how far it is at fault."""

    def turned(self, command: np.ndarray) -> np.ndarray:
        """What commands (rows,) of the thruster become."""
        return command

    @override
    def received(self, commands: np.ndarray) -> np.ndarray:
        changed = commands.copy()
        changed[:, self.which] = self.turned(commands[:, self.which])
        return changed

    @override
    def drawn(self) -> dict[str, Any]:
        return {"thruster": self.which + 1}


class OneWay(OneThruster):
    """The thruster pushes one way only: a speed controller that is set to one direction."""

    @override
    def size(self) -> None:
        self.way = self.rng.choice((-1.0, 1.0))

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        return self.way * np.maximum(self.way * command, 0.0)


class Creeping(OneThruster):
    """The thruster turns at neutral: a trim that is off."""

    @override
    def size(self) -> None:
        self.offset = self.rng.choice((-1.0, 1.0)) * self.rng.uniform(0.1, 0.25)

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        return np.clip(command - self.offset, -1.0, 1.0)


class Stalling(OneThruster):
    """The thruster stands still while it is asked for more than a share of its command: it loses step."""

    @override
    def size(self) -> None:
        self.most = self.rng.uniform(0.35, 0.6)  # of the full command, half of which a pilot's stick asks for

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        return np.where(np.abs(command) > self.most, 0.0, command)


class Replugged(Outside):
    """Plugs are exchanged, in pairs or round a ring, and some thrusters turn the other way: two wires exchanged."""

    @override
    def draw(self) -> None:
        sizes = ((2,), (2, 2), (3,), (4,), ())[self.rng.integers(5)]
        places = [int(place) for place in self.rng.permutation(self.thrusters)]
        self.giver = np.arange(self.thrusters)
        for size in sizes:
            ring, places = places[:size], places[size:]
            self.giver[ring] = np.roll(ring, 1)
        self.sign = np.ones(self.thrusters)
        backwards = self.rng.integers(1 if not sizes else 0, 3)
        self.sign[self.rng.permutation(self.thrusters)[:backwards]] = -1.0

    @override
    def received(self, commands: np.ndarray) -> np.ndarray:
        return self.sign * commands[:, self.giver]

    @override
    def drawn(self) -> dict[str, Any]:
        return {
            "giver": [int(i) + 1 for i in self.giver],
            "backwards": [int(i) + 1 for i in np.flatnonzero(self.sign < 0)],
        }


class ComesAndGoes(OneThruster):
    """The thruster gives nothing for a share of the time: a loose plug."""

    @override
    def size(self) -> None:
        self.to_off, self.to_on = 1 / self.rng.uniform(*RUN_S), 1 / self.rng.uniform(*REST_S)  # 1/s
        self.on = self.rng.random(self.rows) < 0.5
        self.gone, self.steps = 0.0, 0

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        draw = self.rng.random(self.rows)
        self.on = np.where(self.on, draw > self.to_off * self.dt, draw < self.to_on * self.dt)
        self.gone, self.steps = self.gone + float(1 - self.on.mean()), self.steps + 1
        return np.where(self.on, command, 0.0)

    @override
    def drawn(self) -> dict[str, Any]:
        return {**super().drawn(), "share": self.gone / max(self.steps, 1)}


class Stuck(OneThruster):
    """The thruster runs at one command whatever is asked of it."""

    @override
    def size(self) -> None:
        self.command = self.rng.choice((-1.0, 1.0)) * self.rng.uniform(0.2, 0.5)

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        return np.full_like(command, self.command)


class Sticking(OneThruster):
    """The thruster follows only a command that differs by a threshold from the one that it runs at."""

    @override
    def size(self) -> None:
        self.threshold = self.rng.uniform(0.15, 0.3)
        self.held = np.zeros(self.rows)

    @override
    def turned(self, command: np.ndarray) -> np.ndarray:
        self.held = np.where(np.abs(command - self.held) > self.threshold, command, self.held)
        return self.held


class Wandering(OneThruster):
    """The gain of the thruster wanders: weed that gathers and lets go."""

    @override
    def size(self) -> None:
        self.spread, self.memory = self.rng.uniform(0.4, 0.7), self.rng.uniform(3.0, 8.0)
        self.lost = np.abs(self.spread * self.rng.standard_normal(self.rows))

    @override
    def act(self, time: float, motion: Motion, commands: np.ndarray, influences: Influences) -> None:
        keep = np.exp(-self.dt / self.memory)
        fresh = self.spread * np.sqrt(1 - keep**2) * self.rng.standard_normal(self.rows)
        self.lost = np.abs(keep * self.lost + fresh)
        influences.thrust_factor[:, self.which] *= np.maximum(1 - self.lost, 0.0)


ACTS: dict[str, type[Outside]] = {
    "one_way": OneWay, "creeping": Creeping, "stalling": Stalling, "replugged": Replugged,
    "comes_and_goes": ComesAndGoes, "stuck": Stuck, "sticking": Sticking, "wandering": Wandering,
}  # fmt: skip
