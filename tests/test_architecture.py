"""The picture of docs/architecture.md is that of the imports."""

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
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("auv_torchrl."):
                found[part].add(node.module.split(".")[1])
    return {part: others - {part} for part, others in found.items() if part != "__init__"}


def test_imports_go_down_and_never_round():
    """Every part stands in the picture, imports its own row and rows below, and no circle is among them."""
    picture = re.findall(r"```\n(.*?)```", (PROJECT / "docs" / "architecture.md").read_text(), re.S)[0]
    rows = [re.split(r"\s{3,}", line)[0].split() for line in reversed(picture.splitlines())]
    height = {part: row for row, parts in enumerate(rows) for part in parts}
    found = imports()
    assert set(found) == set(height)
    assert not {(part, other) for part in found for other in found[part] if height[other] > height[part]}
    TopologicalSorter(found).prepare()  # raises at a circle
