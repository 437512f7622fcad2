"""Numbers as people read them."""

import ast
import re
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from auv_torchrl.effects import EFFECTS
from auv_torchrl.paths import PROJECT
from auv_torchrl.quantities import counted, estimated, number, percent, quantity
from auv_torchrl.vehicle import load_vehicle

COUNTED = (
    r"bytes|channels|coefficients|columns|commands|dives|entries|episodes|fields|files|findings|flights|gaps|kinds|"
    r"lines|logs|messages|motors|numbers|outputs|packets|pairs|parameters|points|records|rows|runs|samples|starts|"
    r"steps|stretches|thrusters|times|values|vehicles|windows"
)
BY_HAND = re.compile(rf" (?!of |and |in |has |have |times |for )(?:[a-z]+ )?(?:{COUNTED})\b")


@pytest.mark.parametrize(
    ("value", "unit", "shown"),
    [
        (0.0015, "m", "1.50 mm"),
        (0.0724, "m", "7.24 cm"),
        (11.96, "m", "12.0 m"),
        (-0.5, "m", "-50.0 cm"),
        (0.0, "m", "0 mm"),
        (1.593, "rad", "91.3°"),
        (0.01, "rad/s", "0.573°/s"),
        (-0.9, "1", "-0.900"),
        (12.0, "N", "12.0 N"),
        (None, "m", "–"),
        (np.nan, "rad", "–"),
    ],
)
def test_a_quantity_has_the_unit_that_people_use(value, unit, shown):
    """Lengths in m, cm or mm, angles in degrees, and no unit where there is none."""
    assert quantity(value, unit) == shown


def test_a_count_has_its_plural():
    """Of one there is a singular."""
    assert [counted(n, "episode") for n in (0, 1, 2, 1500)] == [
        "0 episodes",
        "1 episode",
        "2 episodes",
        "1,500 episodes",
    ]
    assert counted(1, "axis", "axes") == "1 axis" and counted(4, "axis", "axes") == "4 axes"


def counts_by_hand(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Line and noun of each plural that stands behind a count: 1 of it has no singular.

    Named constants are more than 1, numbers with decimals were measured, several numbers at once have a plural, and
    what stands behind ``key=`` or comes from ``named`` is a word.
    """
    for text in (node for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)):
        for before, count, behind in zip([None, *text.values], text.values, text.values[1:], strict=False):
            if isinstance(before, ast.Constant) and str(before.value).endswith("="):
                continue
            if not isinstance(count, ast.FormattedValue) or not isinstance(behind, ast.Constant):
                continue
            source = ast.unparse(count.value)
            measured = count.format_spec is not None and ast.unparse(count.format_spec)[-2] in "efg"
            found = BY_HAND.match(str(behind.value))
            if found and not (
                measured or source.isupper() or "join(" in source or source.startswith(("counted(", "named("))
            ):
                yield count.lineno, source + found[0]


def test_no_sentence_has_a_count_before_a_plural():
    """Who reads "1 rows" doubts the rest: counts are written by ``counted``, which knows the singular."""
    files = sorted((PROJECT / "auv_torchrl").rglob("*.py"))
    trees = {path.name: ast.parse(path.read_text()) for path in files}
    assert not [f"{name}:{line}: {noun}" for name, tree in trees.items() for line, noun in counts_by_hand(tree)]


@pytest.mark.parametrize(
    ("code", "nouns"),
    [
        ('f"{len(rows)} rows lack a number"', ["len(rows) rows"]),
        ('f"and {more:,} broken packets"', ["more broken packets"]),
        ('f"of {n} rows {m} times"', ["n rows", "m times"]),
        ('f"task={name} shows tails, the source of {named(channels)} runs"', []),
        ("f\"{counted(n, 'row')} of {MOST:,} rows, {share:.1f} times, {part} of the rows\"", []),
    ],
)
def test_a_count_before_a_plural_is_found(code, nouns):
    """With an adjective, too; constants, measured numbers and genitives are none."""
    assert [noun for _, noun in counts_by_hand(ast.parse(code))] == nouns


def test_a_share_is_honest_at_both_ends():
    """What is not all of it is not 100 %."""
    assert [percent(s).replace("\u202f", " ") for s in (-0.001, 0.0, 0.001, 0.5, 0.999, 1.0)] == [
        "0 %", "0 %", "< 1 %", "50 %", "> 99 %", "100 %",
    ]  # fmt: skip
    assert [percent(s, sign=True).replace("\u202f", " ") for s in (0.12, -0.5)] == ["+12 %", "-50 %"]


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_the_sentence_of_an_effect_has_degrees_and_no_unit_of_1(effect):
    """Of every parameter, at its lowest value."""
    for member, p in effect.member_parameters(load_vehicle("bluerov2")).items():
        sentence = p.sentence_of(member, p.low)
        assert "rad" not in sentence.split() and "_" not in sentence and (p.discrete or not sentence.endswith(" 1"))
        assert ("°" in sentence) == p.unit.startswith("rad")


@pytest.mark.parametrize(
    ("value", "low", "high", "shown"),
    [
        (-2.77e-5, -0.0045, 0.0045, "0"),
        (-0.0021, -0.006, 0.002, "-0.0021"),  # no zero added, either
        (0.053, -0.094, 0.196, "0.05"),
        (1234.5, -20000.0, 22000.0, "1000"),
        (0.552, 0.54, 0.56, "0.552"),
        (3e-5, 3e-5, 3e-5, "3.00e-05"),
    ],
)
def test_a_value_shows_no_digits_that_its_interval_leaves_open(value, low, high, shown):
    """What is small next to its uncertainty is nothing; what is sure keeps three digits."""
    assert estimated(value, low, high) == shown


@given(st.floats(-1e300, 1e300) | st.sampled_from([np.nan, np.inf, -np.inf]))
def test_any_number_can_be_written(value):
    """Numbers come out as digits that read back within one per cent, others as a dash."""
    text = number(value)
    assert text == "–" if not np.isfinite(value) else float(text) == pytest.approx(value, rel=0.01, abs=1e-300)
