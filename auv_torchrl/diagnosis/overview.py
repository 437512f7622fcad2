"""What a log holds over its whole length, thinned to what a page can show."""

from dataclasses import dataclass

import numpy as np

from auv_torchrl.flightlog import POSE, FlightLog
from auv_torchrl.flightlog.log import Floats

MOST_SAMPLES = 600  # about one for each two points of a page that is 1,100 wide


@dataclass(frozen=True)
class Overview:
    """Curves of a log, its episodes one behind the other as ``Where.onset_s`` counts them."""

    t: Floats  # (T,) s into the log
    begins: tuple[float, ...]  # s, where episodes begin
    episodes: tuple[int, ...]  # their numbers
    depth: Floats  # (T,) m, of NaN where not measured
    heading: Floats  # (T,) rad, likewise
    commands: Floats  # (T, n)
    volts: Floats  # (T,) V, likewise

    @staticmethod
    def of(log: FlightLog) -> "Overview":
        """The overview of a log: every k-th sample."""
        lengths = np.array([float(episode.t[-1]) for episode in log.episodes])
        begins = np.concatenate(([0.0], np.cumsum(lengths)[:-1]))
        t = np.concatenate([begin + episode.t for begin, episode in zip(begins, log.episodes, strict=True)])
        rows = np.unique(np.linspace(0, len(t) - 1, min(len(t), MOST_SAMPLES)).astype(int))
        pose = np.concatenate([episode.pose for episode in log.episodes])[rows]
        volts = [np.full(len(e), np.nan) if e.battery is None else e.battery for e in log.episodes]
        return Overview(
            t=t[rows],
            begins=tuple(begins.tolist()),
            episodes=tuple(episode.number for episode in log.episodes),
            depth=pose[:, POSE.index("z")],
            heading=pose[:, POSE.index("yaw")],
            commands=np.concatenate([episode.commands for episode in log.episodes])[rows],
            volts=np.concatenate(volts)[rows],
        )

    def at(self, episode: int, t: float) -> float:
        """Seconds into the log of a time in an episode."""
        return self.begins[self.episodes.index(episode)] + t
