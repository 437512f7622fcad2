"""YAML files that people write: vehicles, scenarios, randomizations. What cannot be meant is refused in one line."""

import re
import stat
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml
from yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from auv_torchrl.quantities import counted

MOST_BYTES = 100_000  # thirty times the largest file of conf/
MOST_ENTRIES = 10_000  # with aliases written out: a few lines of aliases of aliases are more than any memory holds
_MERGE = "tag:yaml.org,2002:merge"
_STRING = "tag:yaml.org,2002:str"
_INTEGER = "tag:yaml.org,2002:int"
_FLOAT = "tag:yaml.org,2002:float"
_OTHER_BASE = re.compile(r"[-+]?0[0-7_]+|.*:.*")  # 011 is 9 in YAML 1.1, and 11:50 is 710
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")


class YamlFileError(ValueError):
    """A YAML file that cannot be used; the message names the file, the cause and the remedy."""


class _Loader(yaml.SafeLoader):
    """Plain values only, and 1e-3 is a number as it is for Hydra; YAML 1.1 asks for 1.0e-3."""

    def construct_object(self, node: Node, deep: bool = False) -> Any:
        """The value of a node; one that looks like a number or a date and is none is an error with its line."""
        try:
            return super().construct_object(node, deep)
        except ValueError as error:  # a month 13, an integer of 5,000 digits
            raise yaml.constructor.ConstructorError(
                None, None, f"no number or date: {error}", node.start_mark
            ) from error


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d[\d_]*\.?[\d_]*|\.\d[\d_]*)[eE][-+]?\d+$", re.ASCII),
    list("-+.0123456789"),
)


def read_yaml(path: Path, what: str, plain: bool = True) -> dict[str, Any]:
    """The mapping in a YAML file.

    Args:
        path: the file.
        what: what it describes, for messages, e.g. "vehicle".
        plain: whether ``${...}``, which Hydra would replace, and a file without content are refused.

    Raises:
        FileNotFoundError: if there is no such file.
        YamlFileError: for what is no readable file of text, no YAML, no mapping of names, larger than a file of
            settings can be, or holds a name twice.
    """
    named = f"{what} file {path}"
    return deepcopy(_parsed(_read_text(path, named), named, plain))


@lru_cache(64)  # a command reads each of its files several times, and Python parses for 10 ms each time
def _parsed(text: str, named: str, plain: bool) -> dict[str, Any]:
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        if node is None and not plain:
            return {}
        if not isinstance(node, MappingNode):
            kind = "nothing" if node is None else "a list" if isinstance(node, SequenceNode) else "one value"
            raise YamlFileError(f"{named}: expected a mapping, lines like 'name: value', got {kind}: write it so")
        _count(node, named, plain, {}, set())
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = "" if mark is None else f", line {mark.line + 1}"
        problem = " ".join((error.problem or error.context or "").split())
        raise YamlFileError(f"{named}{where} is no YAML ({problem}): mend that line or the one before") from error
    except yaml.YAMLError as error:  # of the reader: characters that no text has
        problem = str(error).splitlines()[0]
        raise YamlFileError(f"{named} is no YAML ({problem}): save it as plain text in UTF-8") from error
    except RecursionError as error:
        raise YamlFileError(f"{named} is nested too deeply: write a mapping of sections, names and numbers") from error


def _read_text(path: Path, named: str) -> str:
    remedy = "give a YAML file"
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise YamlFileError(f"{named} is a directory: {remedy}")
        if not stat.S_ISREG(status.st_mode):  # a pipe would wait for ever, a device may never end
            raise YamlFileError(f"{named} is a pipe or device: {remedy}")
        if status.st_size > MOST_BYTES:
            raise YamlFileError(
                f"{named} has {counted(status.st_size, 'byte')}, settings have {MOST_BYTES:,} at most: {remedy} with "
                "them alone"
            )
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise FileNotFoundError(f"there is no {named}: {remedy} that exists") from error
    except OSError as error:
        raise YamlFileError(f"{named} cannot be read ({error.strerror}): {remedy} that you may read") from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        cause = "UTF-16" if content.startswith(_UTF_16) else f"byte {error.start + 1} is no UTF-8"
        raise YamlFileError(f"{named} is not in UTF-8 ({cause}): save it as UTF-8") from error


def _count(node: Node, named: str, plain: bool, known: dict[int, int], above: set[int]) -> int:
    """Entries below a node with aliases written out; refuses what loading would swallow silently."""
    if id(node) in above:
        raise YamlFileError(f"{named}, line {_line(node)}: an alias contains itself: write the values out")
    if id(node) in known:
        return known[id(node)]
    count = 1
    if isinstance(node, ScalarNode):
        if plain and "${" in node.value:
            raise YamlFileError(
                f"{named}, line {_line(node)}: {node.value[:60]!r} refers to something outside of the file: "
                "write the value itself"
            )
        if node.tag in (_INTEGER, _FLOAT) and _OTHER_BASE.fullmatch(node.value):
            raise YamlFileError(
                f"{named}, line {_line(node)}: YAML reads {node.value[:60]!r} to the base 8 or 60: write it as a "
                "decimal number, or in quotes if it is a word"
            )
    elif isinstance(node, MappingNode):
        _check_names(node, named)
        parts = [part for pair in node.value for part in pair]
        count += sum(_count(part, named, plain, known, above | {id(node)}) for part in parts)
    elif isinstance(node, SequenceNode):
        count += sum(_count(part, named, plain, known, above | {id(node)}) for part in node.value)
    if count > MOST_ENTRIES:
        raise YamlFileError(
            f"{named}, line {_line(node)}: more than {MOST_ENTRIES:,} entries with aliases written out: "
            "write the values themselves, without & and *"
        )
    known[id(node)] = count
    return count


def _check_names(node: MappingNode, named: str) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if key.tag == _MERGE:
            continue
        if key.tag != _STRING:
            shown = repr(key.value[:40]) if isinstance(key, ScalarNode) else "a list or mapping"
            raise YamlFileError(f"{named}, line {_line(key)}: {shown} is no name: give a word, in quotes if need be")
        if key.value in first:
            raise YamlFileError(
                f"{named}, line {_line(key)}: {key.value[:40]!r} is given twice, first in line {first[key.value]}: "
                "keep one of them"
            )
        first[key.value] = _line(key)


def _line(node: Node) -> int:
    return node.start_mark.line + 1
