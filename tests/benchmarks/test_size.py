"""What the counts of the diagnosis count."""

import ast

from benchmarks.size import COUNTED, Size, code_lines, constants, modules

TEXT = '''"""Head,
of two lines."""

import math  # why

NEAR, FAR = 1, 2.0  # two constants
NAMES = ("a", "b")
lower = 3


def f(x):
    """One line."""
    # a comment
    text = """no docstring,
but code"""
    return x + NEAR
'''


def test_code_is_what_is_neither_blank_nor_comment_nor_docstring():
    """A string that is given to a name is code; constants are capitals with numbers."""
    tree = ast.parse(TEXT)
    assert code_lines(TEXT, tree) == {4, 6, 7, 8, 11, 14, 15, 16}
    assert list(constants(tree)) == ["NEAR", "FAR"]


def test_all_parts_are_there_and_the_sum_is_that_of_its_parts(tmp_path):
    """No folder of the counts is empty, and both are as much as one and the other."""
    sizes = {part: Size.of(modules(*given)) for part, given in COUNTED.items()}
    assert all(size.modules and size.code < size.lines for size in sizes.values())
    for at in (0, 1, 2, 3):
        both = sizes["both"][at]
        assert both == sizes["diagnosis, without its report"][at] + sizes["sysid"][at]
