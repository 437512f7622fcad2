"""The command ``auv-export``: what it refuses."""

import pytest

from auv_torchrl.extras import MissingLibrary, library
from tests.command_lines import answers_of

LINES = {
    "policy=nowhere": "holds no policy: give a folder of outputs/policies, or that of a run of auv-train",
    "polcy=nowhere": "did you mean policy",
    "output=out": "policy",
}


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """Of all the lines, in one process."""
    folder = tmp_path_factory.mktemp("out")
    lines = {line: [line] for line in LINES}
    lines = {
        line: [*given, *([f"output={folder / 'new'}"] if "output" not in line else [])] for line, given in lines.items()
    }
    return answers_of("auv_torchrl.export.command", lines)


@pytest.mark.parametrize("line", LINES)
def test_a_mistaken_line_is_answered_by_one_that_says_what_to_give(answers, line):
    """With exit code 2."""
    code, _, errors = answers[line]
    assert code == 2 and LINES[line] in errors and errors.count("\n") == 1, errors


def test_without_the_library_it_is_said_how_to_get_it():
    """The extra is named."""
    with pytest.raises(MissingLibrary, match=r"pip install 'auv_torchrl\[fly\]'"):
        library("no_such_runtime", "flying an export needs", "fly")
