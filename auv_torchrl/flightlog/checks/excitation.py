"""What the commands of a log can show at all."""

import numpy as np

from auv_torchrl.flightlog.findings import Finding, Severity
from auv_torchrl.flightlog.log import ALONE, Episode
from auv_torchrl.quantities import percent

SHORT_S = 10.0  # below this most effects are not identifiable
SATURATED = 0.999
MOSTLY = 0.8  # of the samples
STILL = 0.01  # standard deviation of a command that shows nothing


def check_excitation(episodes: tuple[Episode, ...]) -> list[Finding]:
    """Findings about length, constant, saturated and indistinguishable commands."""
    findings = []
    duration = sum(episode.duration for episode in episodes)
    if duration < SHORT_S:
        sentence = f"the log holds {duration:.1f} s of data: few effects can be told from so little"
        findings.append(Finding(Severity.WARNING, "short_log", sentence, "Fly a minute or more"))
    if len(episodes) == 1:
        sentence = "the log is one episode: without another one to test on, a part of it is held out"
        findings.append(Finding(Severity.INFO, ALONE, sentence, "A second flight would test it better"))
    commands = np.concatenate([episode.commands for episode in episodes])
    names = [f"cmd_{i + 1}" for i in range(commands.shape[1])]
    still = commands.std(axis=0) < STILL
    if still.all():
        sentence = "no command changes during the log: what the thrusters do cannot be told"
        findings.append(Finding(Severity.WARNING, "constant_commands", sentence, "Vary the commands", tuple(names)))
    elif still.any():
        quiet = tuple(name for name, is_still in zip(names, still, strict=True) if is_still)
        sentence = f"{', '.join(quiet)} never change: faults of these thrusters cannot be told"
        findings.append(Finding(Severity.WARNING, "unused_thruster", sentence, "Use every thruster", quiet))
    share = (np.abs(commands) >= SATURATED).mean(axis=0)
    if len(full := np.flatnonzero((share > MOSTLY) & ~still)):
        sentence = ", ".join(f"{names[i]} is at its limit {percent(share[i])} of the time" for i in full)
        remedy = "Command less: at the limit a thruster shows neither its gain nor its curve"
        findings.append(Finding(Severity.WARNING, "saturated", sentence, remedy, tuple(names[i] for i in full)))
    return findings
