"""The picture of docs/explanation/architecture.md is that of the imports."""

import ast
import re
from graphlib import TopologicalSorter

from auv_torchrl.paths import PROJECT

PACKAGE = PROJECT / "auv_torchrl"


def imports():
    """By part of the package, the other parts that it imports."""
    found = {path.stem: set() for path in PACKAGE.iterdir() if not path.name.startswith("_") and path.name != "conf"}
    for path in PACKAGE.rglob("*.py"):
        part = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("auv_torchrl."):
                found[part].add(node.module.split(".")[1])
    return {part: others - {part} for part, others in found.items() if part != "__init__"}


def test_imports_go_down_and_never_round():
    """Every part stands in the picture, imports its own row and rows below, and no circle is among them."""
    picture = re.findall(r"```\n(.*?)```", (PROJECT / "docs" / "explanation" / "architecture.md").read_text(), re.S)[0]
    rows = [re.split(r"\s{3,}", line)[0].split() for line in reversed(picture.splitlines())]
    height = {part: row for row, parts in enumerate(rows) for part in parts}
    found = imports()
    assert set(found) == set(height)
    assert not {(part, other) for part in found for other in found[part] if height[other] > height[part]}
    TopologicalSorter(found).prepare()  # raises at a circle


FILES = sorted(path for part in ("auv_torchrl", "benchmarks") for path in (PROJECT / part).rglob("*.py"))


def length(function):
    """Lines of a function without its docstring, which says to a stranger what the code cannot."""
    first = function.body[0]
    said = first.end_lineno - first.lineno + 1 if ast.get_docstring(function, clean=False) is not None else 0
    return function.end_lineno - function.lineno + 1 - said


def has_reason(function, lines):
    """Whether the line above a function, or above its decorators, begins with ``# long:`` and a reason."""
    first = min([function.lineno, *(decorator.lineno for decorator in function.decorator_list)])
    return lines[first - 2].strip().startswith("# long: ")


def test_no_file_class_or_function_is_too_long():
    """Files have up to 600 lines, classes up to 15 methods, and functions up to 50 lines or a reason above them."""
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    long = []
    for path in FILES:
        lines = path.read_text().splitlines()
        long += [f"{path}: {len(lines)} lines"] if len(lines) > 600 else []
        for node in ast.walk(ast.parse("\n".join(lines))):
            if isinstance(node, functions) and length(node) > 50 and not has_reason(node, lines):
                long.append(f"{path}: {node.name} has {length(node)} lines")
            if isinstance(node, ast.ClassDef) and (many := sum(isinstance(n, functions) for n in node.body)) > 15:
                long.append(f"{path}: {node.name} has {many} methods")
    assert not long
