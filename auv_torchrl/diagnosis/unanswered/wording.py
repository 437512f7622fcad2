"""What is said of channels that do not answer to commands."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

from auv_torchrl.diagnosis.unanswered.stillness import Stillness, channels_of
from auv_torchrl.flightlog import Finding, Severity
from auv_torchrl.quantities import percent, series
from auv_torchrl.sensors import CHANNELS

STILL = "does_not_answer"
STANDS = "stands"
NOTHING_MOVES = "nothing_moves"
HELD = "held"
ELSEWHERE = "not_of_this_vehicle"
NOTHING_FOLLOWS = "nothing_follows"
OF_ALL = {  # what is said of everything that was measured
    NOTHING_MOVES: "the vehicle does not move at all, whatever is commanded",
    HELD: "the vehicle does not move with its commands",
    NOTHING_FOLLOWS: "nothing that was measured follows the commands",
}
NAMES = {
    ("x", "y"): "position", ("x",): "north position", ("y",): "east position", ("z",): "depth",
    ("roll", "pitch", "yaw"): "attitude", ("roll",): "roll", ("pitch",): "pitch", ("yaw",): "heading",
    ("u", "v", "w"): "velocity", ("u",): "surge speed", ("v",): "sway speed", ("w",): "heave speed",
    ("p", "q", "r"): "turning rate", ("p",): "roll rate", ("q",): "pitch rate", ("r",): "yaw rate",
    ("ax", "ay", "az"): "specific force", ("ax",): "surge specific force", ("ay",): "sway specific force",
    ("az",): "heave specific force",
}  # fmt: skip
FLOATS = {"z"}, {"z", "w"}  # channels that stand still at the surface and on the bottom
FREE = "whether the vehicle is in the water and free to move"


def tell(still: Sequence[Stillness], whole: bool, episodes: int) -> tuple[Finding, ...]:
    """A finding for all channels that stand still in the same stretches.

    Args:
        still: what stands still.
        whole: whether nothing else moves in these stretches.
        episodes: of the log: of one, its number is not told.
    """
    together: dict[tuple[str, ...], list[Sequence[Stillness]]] = {}
    for group in _groups(still):
        together.setdefault(channels_of(group), []).append(group)
    return tuple(_finding(channels, _when(groups, episodes), whole) for channels, groups in together.items())


def tell_stands(held: Sequence[Stillness], episodes: int) -> tuple[Finding, ...]:
    """The finding about stretches in which every channel stands still; ``episodes`` as of the log."""
    return (_motionless(STANDS, _when(_groups(held), episodes), channels_of(held)),)


def tell_held(share: float, channels: Iterable[str]) -> Finding:
    """The finding about a vehicle that hardly moves, and not with the commands.

    Args:
        share: how far it moves, of how far the commands should move it.
        channels: that were measured.
    """
    sentence = (
        f"the vehicle does not move with its commands ({percent(share)} of what they should make of it): it is on deck "
        "or held, or its thrusters have no power"
    )
    remedy = f"Look {FREE}, and whether its thrusters have power"
    return Finding(Severity.WARNING, HELD, sentence, remedy, tuple(channels))


def tell_other_source(false: Sequence[Stillness], episodes: int, whole: bool = False) -> tuple[Finding, ...]:
    """The finding about channels that do not follow the vehicle, all along or from a moment on.

    Args:
        false: these channels, of one source or all of the log.
        episodes: of the log: of one, its number is not told.
        whole: whether these are all channels.
    """
    channels = channels_of(false)
    name, when = named(channels), ""
    if (first := false[0]).episode is not None:
        when = f"from {first.first_s:.0f} s" + (f" of episode {first.episode}" if episodes > 1 else "") + " on "
    if whole:
        sentence = (
            f"{when}nothing of what the thrusters should do shows in any channel: {name} are of another time or "
            "vehicle than the commands, or the thrusters have no power and something else moves the vehicle"
        )
        remedy = f"Look whether commands and {name} are of one dive and one clock, and whether the thrusters have power"
    else:
        sentence = f"{when}{name} {_does(name)} not follow the vehicle, which all other channels show as it should be"
        remedy = f"Look at the source of the {name}: whether it is this vehicle's, of this dive, and alive"
    code = NOTHING_FOLLOWS if whole else ELSEWHERE
    return (Finding(Severity.WARNING, code, sentence, remedy, channels),)


def tell_contradiction(false: Sequence[Stillness], episodes: int) -> tuple[Finding, ...]:
    """The finding about channels of one source that contradict all others; ``episodes`` as of the log."""
    (own,) = tell_other_source(false, episodes)
    name = named(own.columns)
    when, _, _ = own.sentence.partition(name)
    sentence = f"{when}{name} {_does(name)} not follow the vehicle: other channels tell of another motion, and agree"
    return (replace(own, sentence=sentence),)


def not_answering(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings about channels that do not answer to commands, or do not follow the vehicle."""
    return tuple(finding for finding in findings if finding.code in (STILL, ELSEWHERE, STANDS, *OF_ALL))


def named(channels: Iterable[str]) -> str:
    """Channels in words, those that belong together as one."""
    left, words = sorted(channels, key=CHANNELS.index), []
    for members, name in NAMES.items():
        if set(members) <= set(left):
            words.append((CHANNELS.index(members[0]), name))
            left = [channel for channel in left if channel not in members]
    return series(name for _, name in sorted(words))


def is_all(findings: Iterable[Finding]) -> bool:
    """Whether nothing that was measured is left beside what does not answer."""
    return any(finding.code in OF_ALL for finding in findings)


def in_words(findings: Iterable[Finding]) -> str:
    """A clause: what does not answer to commands, or does not follow the vehicle."""
    found = list(findings)
    codes = {finding.code for finding in found}
    for code, clause in OF_ALL.items():
        if code in codes:
            return clause
    if codes == {STANDS}:
        return "the vehicle does not move at all for a while, whatever is commanded"
    name = named({column for finding in found if finding.code != STANDS for column in finding.columns})
    does = "follow the vehicle" if ELSEWHERE in codes else "answer to any command"
    return f"{name} {_does(name)} not {does}"


def _does(name: str) -> str:
    return "do" if " and " in name else "does"


def _groups(still: Sequence[Stillness]) -> list[list[Stillness]]:
    """What stands still at the same time, together."""
    groups: list[list[Stillness]] = []
    for entry in sorted(still, key=lambda one: (one.episode is not None, one.episode or 0, one.first_s)):
        together = (group for group in groups if group[0].is_with(entry))
        group = next(together, None)
        if group is None:
            groups.append([entry])
        else:
            group.append(entry)
    return groups


def _finding(channels: tuple[str, ...], when: str, whole: bool) -> Finding:
    if whole:
        return _motionless(NOTHING_MOVES, when, channels)
    name = named(channels)
    floats = set(channels) in FLOATS
    stands = "the vehicle floats or stands" if floats else "the vehicle is held"
    sentence = f"{when}{name} {_does(name)} not answer to any command: look at the sensor, or {stands}"
    free = "whether the vehicle floats at the surface or stands on the bottom" if floats else FREE
    remedy = f"Look at the source of the {name}, and {free}"
    return Finding(Severity.WARNING, STILL, sentence, remedy, channels)


def _motionless(code: str, when: str, channels: tuple[str, ...]) -> Finding:
    """The finding that every channel stands still, all along or in the stretches that ``when`` says."""
    sentence = (
        f"{when}the vehicle does not move at all, whatever is commanded: it is on deck or held, its thrusters have "
        "no power, or the source of the log stands still"
    )
    remedy = f"Look {FREE}, whether its thrusters have power, and whether the source of {named(channels)} runs"
    return Finding(Severity.WARNING, code, sentence, remedy, channels)


def _when(groups: Sequence[Sequence[Stillness]], episodes: int) -> str:
    """The stretches of groups in words, those of the same seconds of several episodes as one."""
    alike: dict[str, list[int]] = {}
    for group in groups:
        if group[0].episode is None:
            return ""
        first, last = max(entry.first_s for entry in group), min(entry.last_s for entry in group)
        alike.setdefault(f"from {first:.0f} s to {last:.0f} s", []).append(group[0].episode)
    if episodes == 1:
        return f"{series(alike)} "
    of = (f"{'episodes' if len(numbers) > 1 else 'episode'} {series(numbers)}" for numbers in alike.values())
    return series(f"{when} of {which}" for when, which in zip(alike, of, strict=True)) + " "
