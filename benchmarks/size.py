"""``python -m benchmarks.size``: how much there is to read of the diagnosis and its engine, counted from the source.

Lines of code are those that are neither blank, nor a comment, nor in a docstring. A constant is a name in capitals that
a module gives a number, or numbers.
"""

import argparse
import ast
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from auv_torchrl.paths import PROJECT
from benchmarks import published

PACKAGE = PROJECT / "auv_torchrl"
PAGE = PROJECT / "docs" / "results" / "ablation.md"
COUNTED = {  # row: folders, and what in them counts elsewhere
    "diagnosis, without its report": (("diagnosis",), ("diagnosis/report",)),
    "sysid": (("sysid",), ()),
    "both": (("diagnosis", "sysid"), ("diagnosis/report",)),
    "diagnosis/report": (("diagnosis/report",), ()),
    "monitoring": (("monitoring",), ()),
}
MUST = "both: must"  # what is wanted of the row above


class Size(NamedTuple):
    """How much there is of some modules."""

    modules: int
    lines: int
    code: int
    constants: int
    longest: int  # lines of the longest function

    @classmethod
    def of(cls, paths: list[Path]) -> "Size":
        """Of modules."""
        texts = [path.read_text(encoding="utf-8") for path in paths]
        trees = [ast.parse(text) for text in texts]
        functions = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        return cls(
            len(paths),
            sum(text.count("\n") for text in texts),
            sum(len(code_lines(text, tree)) for text, tree in zip(texts, trees, strict=True)),
            sum(1 for tree in trees for _ in constants(tree)),
            max((node.end_lineno or 0) - node.lineno + 1 for node in functions),
        )


def modules(folders: tuple[str, ...], without: tuple[str, ...] = ()) -> list[Path]:
    """Of some folders of the package, in order."""
    found = {path for folder in folders for path in (PACKAGE / folder).rglob("*.py")}
    return sorted(found - {path for folder in without for path in (PACKAGE / folder).rglob("*.py")})


def code_lines(text: str, tree: ast.Module) -> set[int]:
    """Numbers of the lines that hold code."""
    left_out = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    held = {row for t in tokens if t.type not in left_out for row in range(t.start[0], t.end[0] + 1)}
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        if isinstance(node, documented) and ast.get_docstring(node) is not None:
            held -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    return held


def constants(tree: ast.Module) -> Iterator[str]:
    """Names in capitals that a module gives numbers."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and any(isinstance(one, ast.Constant) for one in ast.walk(node.value)):
            numbers = [one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant)]
            names = [one for target in node.targets for one in ast.walk(target) if isinstance(one, ast.Name)]
            if any(isinstance(number, int | float) for number in numbers):
                yield from (name.id for name in names if name.id.isupper())


def report() -> str:
    """The table."""
    lines = ["| part | modules | lines | of code | constants | longest function |", "|---|---:|---:|---:|---:|---:|"]
    for part, (folders, without) in COUNTED.items():
        size = Size.of(modules(folders, without))
        lines.append(f"| {part} | {' | '.join(f'{number:,}' for number in size)} |")
        if MUST.startswith(f"{part}:"):
            lines.append(f"| {MUST} | 60 | 7,000 | | 60 | |")
    return "\n".join(lines)


def main() -> None:
    """Print, or write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.size", description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--publish", action="store_true", help=f"write the table into {PAGE.relative_to(PROJECT)}")
    asked = parser.parse_args()
    commit = published.commit_to_name(parser, PAGE, "size", asked.publish)
    print(text := report())
    if asked.publish:
        published.publish(PAGE, "size", text, "python -m benchmarks.size", commit)


if __name__ == "__main__":
    main()
