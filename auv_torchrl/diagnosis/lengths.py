"""What is learnt from and what is held out, and whether both are long enough, before anything is computed."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from auv_torchrl.diagnosis.identify.hypotheses import Settings
from auv_torchrl.diagnosis.motion.cut import cut_windows
from auv_torchrl.diagnosis.motion.windows import Windows
from auv_torchrl.diagnosis.validate.predict import cut_stretches
from auv_torchrl.flightlog import Episode, Finding, FlightLog, FlightLogError, Severity, join
from auv_torchrl.flightlog.readiness import HELD_OUT, LEARNT, ROUNDING_S, START_S, shortest
from auv_torchrl.physics import CONTROL_DT
from auv_torchrl.quantities import counted

# Of a log, as much as is looked at: ten times what its windows hold. What commands do is worked out along all of it for
# each candidate, in memory that grows with its length.
MOST_S, STRETCH_S = 3600.0, 120.0
# Bytes of the commands of all episodes on the grid of the windows, on which each is as long as the longest.
MOST_COMMANDS = 64 << 20
FINEST_S = CONTROL_DT / 2  # of that grid, where samples do not come faster


def stretches_of(log: FlightLog) -> FlightLog:
    """The log, or of one that is very long as many stretches as are looked at, spread evenly over its episodes.

    One whose episodes differ so much in length that the longest would fill the memory is cut into stretches, too.
    """
    longest = max(episode.duration for episode in log.episodes)
    each = _bytes_per_s(log)
    if log.duration <= MOST_S and len(log.episodes) * longest * each <= MOST_COMMANDS:
        return log
    parts: list[Episode] = []
    for episode in log.episodes:
        share = episode.duration / STRETCH_S
        count = max(1, int(np.ceil(share)) if log.duration <= MOST_S else round(share * MOST_S / log.duration))
        for begin in np.linspace(episode.t[0], max(episode.t[0], episode.t[-1] - STRETCH_S), count):
            first, behind = np.searchsorted(episode.t, (begin, begin + STRETCH_S)).tolist()
            parts.append(episode.rows(first, behind))
    most = max(1, int(MOST_COMMANDS / (STRETCH_S * each)))
    lengths = np.array([part.duration for part in parts])
    kept = np.sort(np.argsort(-lengths, kind="stable")[:most]).tolist()
    episodes = tuple(replace(parts[place], number=number) for number, place in enumerate(kept))
    sentence = (
        f"{log.name} lasts {log.duration / 3600:.1f} h in {counted(len(log.episodes), 'episode')}, of which "
        f"{counted(len(episodes), 'stretch', 'stretches')} of at most {STRETCH_S:g} s, spread evenly, are looked at; "
        "the rest is left out"
    )
    finding = Finding(Severity.WARNING, "stretches", sentence, "Give the part that matters as a log of its own")
    return replace(log, episodes=episodes, findings=(*log.findings, finding))


def _bytes_per_s(log: FlightLog) -> float:
    """Bytes that the commands of a second take on the grid of the windows."""
    within = max(1 if episode.parts is None else episode.parts.shape[1] for episode in log.episodes)
    rows_per_s = log.samples / max(log.duration, FINEST_S)
    return 8 * log.thrusters * within * max(1 / FINEST_S, rows_per_s)


def share_findings(windows: Windows, learnt: FlightLog) -> tuple[Finding, ...]:
    """A finding where what was learnt from holds more windows than a diagnosis looks at, or than fit its memory."""
    if windows.share >= 1:
        return ()
    length = windows.steps * windows.dt
    sentence = (
        f"of {learnt.duration / 60:.0f} min that are learnt from, {windows.share:.0%} are looked at, in windows of "
        f"{length:.1f} s spread evenly over them: more would take too much time and memory"
    )
    return (Finding(Severity.WARNING, "looked_at", sentence, "Give the part that matters as a log of its own"),)


def split(log: FlightLog, test: Sequence[FlightLog]) -> tuple[FlightLog, FlightLog, tuple[int, ...]]:
    """What to learn from, what to test on, and the numbers of the held-out episodes."""
    if test:
        return log, join(test), ()
    if len(log.episodes) >= HELD_OUT:
        last = log.episodes[-1].number
        return log.only(e.number for e in log.episodes[:-1]), log.only([last]), (last,)
    cut = [int(LEARNT * len(episode)) for episode in log.episodes]
    early = replace(log, episodes=tuple(e.rows(0, k) for e, k in zip(log.episodes, cut, strict=True)))
    late = replace(log, episodes=tuple(e.rows(k, len(e)) for e, k in zip(log.episodes, cut, strict=True)))
    return early, late, tuple(e.number for e in log.episodes)


def spread(log: FlightLog, pieces: int, seconds: float) -> FlightLog:
    """Pieces of a log, spread evenly over it, each so long, or as long as its episode."""
    ends = np.cumsum([episode.duration for episode in log.episodes])
    parts: list[Episode] = []
    for number, middle in enumerate(ends[-1] * (np.arange(pieces) + 0.5) / pieces):
        place = int(np.searchsorted(ends, middle))
        episode = log.episodes[place]
        within = episode.t[-1] - ends[place] + middle - seconds / 2
        begin = max(episode.t[0], min(within, episode.t[-1] - seconds))
        first, behind = np.searchsorted(episode.t, (begin, begin + seconds)).tolist()
        parts.append(replace(episode.rows(first, behind), number=number))
    return replace(log, episodes=tuple(parts))


def check_lengths(
    training: FlightLog, testing: FlightLog, healthy: Sequence[FlightLog], cut: bool, settings: Settings
) -> None:
    """Refuse logs that hold no window, by the very cuts that the diagnosis makes.

    Args:
        training: what is learnt from.
        testing: what is predicted.
        healthy: logs of the sound vehicle.
        cut: whether ``training`` and ``testing`` are the first and the last part of the same episodes.
        settings: of the diagnosis.

    Raises:
        FlightLogError: naming the log, the settings and how long an episode must be.
    """
    learn, predict, shared = shortest(settings.lead_s, settings.window_s)
    lead, window = f"diagnosis.lead_s={settings.lead_s:g}", f"diagnosis.window_s={settings.window_s:g}"

    def windows(log: FlightLog) -> Windows:
        return cut_windows(log, settings.window_s, settings.lead_s, settings.bin_s)

    def stretches(log: FlightLog) -> Windows:
        return cut_stretches(log, settings)[0]

    if healthy:
        _check(windows, join(healthy), learn, f"a healthy log needs {lead} and {window}", learn)
    first = "of each episode the first four fifths" if cut else "an episode to learn from"
    _check(windows, training, learn, f"{first} must hold {lead} and {window}", shared if cut else learn)
    last = "of each episode the last fifth, held out," if cut else "an episode to predict"
    other = ", or give another log as test=FILE" if cut else ""
    _check(stretches, testing, predict, f"{last} must hold {lead} and {START_S:g} s", shared if cut else predict, other)


def _check(
    cut: Callable[[FlightLog], Windows], log: FlightLog, least_s: float, why: str, needed_s: float, other: str = ""
) -> None:
    try:
        cut(log)
    except FlightLogError as error:
        longest = max(episode.duration for episode in log.episodes)
        if longest > least_s + ROUNDING_S:  # long enough, but with pauses: the error says what it lacks
            raise
        if log.is_idle:
            raise FlightLogError(
                f"{log.name} holds no dive: no thruster turns in it, and it is short: give the log of a dive, of "
                f"{needed_s:.1f} s or more"
            ) from error
        raise FlightLogError(
            f"{log.name} is too short: {why} ({least_s:g} s), and there are {max(longest, 0):.1f} s at most: "
            f"give an episode of {needed_s:.1f} s or more{other}, or make these settings smaller"
        ) from error
