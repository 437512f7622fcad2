"""The picture of a whole log."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
from flown_logs import fly, hold
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_torchrl.diagnosis.report.dive import dive
from auv_torchrl.diagnosis.verdict import MOST_SAMPLES, Overview
from auv_torchrl.vehicle import load_vehicle

PAPER = load_vehicle("paper")
LOG = fly(hold(PAPER), {}, seed=1, episodes=3, seconds=20.0)


def test_episodes_stand_one_behind_the_other():
    """Times grow over all episodes, each of which begins where the one before ends, and few samples are kept."""
    overview = Overview.of(LOG)
    assert (np.diff(overview.t) >= 0).all() and len(overview.t) <= MOST_SAMPLES
    ends = np.cumsum([episode.t[-1] for episode in LOG.episodes])
    assert overview.t[-1] == ends[-1] and overview.begins == (0.0, *ends[:-1].tolist())
    assert overview.at(LOG.episodes[1].number, 3.0) == ends[0] + 3.0


@given(st.integers(1, 40), st.integers(1, 8), st.booleans(), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_any_log_has_a_picture(samples, thrusters, measured, seed):
    """Of one sample or many, with gaps, without depth or volts: sound XML, and every number in it is finite."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(3, samples)) * 10.0 ** rng.integers(-6, 6)
    values[:, rng.random(samples) < 0.3] = np.nan
    values = values if measured else np.full_like(values, np.nan)
    commands = rng.uniform(-1, 1, (samples, thrusters))
    overview = Overview(np.sort(rng.uniform(0, 1e4, samples)), (0.0,), (0,), values[0], values[1], commands, values[2])
    picture = dive(overview, [(1.0, 5.0)], onset_s=3.0)
    assert ElementTree.fromstring(picture).attrib["aria-label"].startswith("The whole log over time")
    assert not re.search(r"\b(nan|inf)\b", picture)


def test_commands_are_drawn_by_their_way_and_size():
    """A thruster that runs forwards and then backwards has cells of both colours, the larger command the darker."""
    commands = np.repeat([[0.2], [1.0], [-1.0], [0.0]], 10, axis=0)
    overview = replace(Overview.of(LOG), t=np.arange(40.0), begins=(0.0,), commands=commands,
                       depth=np.full(40, np.nan), heading=np.full(40, np.nan), volts=np.full(40, np.nan))  # fmt: skip
    picture = dive(overview)
    assert picture.count('class="forwards"') == 20 and picture.count('class="backwards"') == 10
    assert 'fill-opacity="0.32"' in picture and 'fill-opacity="1.00"' in picture


def test_nothing_is_drawn_where_the_log_pauses():
    """A stretch that was cut out has neither a line across nor a command that lasts."""
    t = np.concatenate([np.arange(20.0), np.arange(500.0, 520.0)])
    overview = replace(Overview.of(LOG), t=t, begins=(0.0,), commands=np.ones((40, 1)), depth=np.ones(40),
                       heading=np.full(40, np.nan), volts=np.full(40, np.nan))  # fmt: skip
    picture = dive(overview)
    widths = [float(width) for width in re.findall(r'class="forwards"[^>]* width="([0-9.]+)"', picture)]
    (curve,) = re.findall(r'class="curve after" d="([^"]+)"', picture)
    assert max(widths) < 40.0 and curve.count("M") == 2
