"""No test fails by the clock, and none runs otherwise where CI is set."""

import re
import subprocess
import sys

import pytest
from hypothesis import settings

from auv_torchrl.paths import PROJECT

SHOW = "import tests.everybody; from hypothesis import settings as s; print(repr(s()))"


@pytest.mark.parametrize("ci", ["true", ""])
def test_property_tests_are_the_same_with_and_without_ci(ci):
    """One profile, without a deadline; asked of a fresh process, because hypothesis looks at CI once."""
    environment = {"CI": ci} if ci else {}
    done = subprocess.run([sys.executable, "-c", SHOW], capture_output=True, text=True, cwd=PROJECT, env=environment)
    assert done.stdout.strip() == repr(settings.get_profile("everybody")), done.stderr
    assert repr(settings()) == done.stdout.strip()  # conftest.py has it loaded


def test_no_test_asks_for_another_deadline():
    """A time limit of one example measures the machine."""
    for path in (PROJECT / "tests").rglob("*.py"):
        assert not re.search(r"deadline=(?!None)\w", path.read_text()), path
