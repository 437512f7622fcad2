"""A command with a plain command line: its words are read, its settings composed, its folder claimed, then it works.

What needs a library is imported where it is needed: ``--help`` and completion answer without any.
"""

import functools
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

from auv_torchrl.command.ending import VERSION, ending, on_cluster, say, terminable
from auv_torchrl.command.errors import BAD_INPUT, BadInput, one_line, writing
from auv_torchrl.command.options import CommandLine
from auv_torchrl.command.run import Run
from auv_torchrl.paths import config_names

if TYPE_CHECKING:
    from omegaconf import DictConfig

Task = Callable[["DictConfig", Run], None]
Schemas = Callable[[], Mapping[str, type]]
_COMPLETION = ("--completion", "--complete")
_SHOW = ("--cfg", "-c")  # --cfg job, as Hydra has it


def command(line: CommandLine, schemas: Schemas, has_folder: bool = True) -> Callable[[Task], Callable[[], None]]:
    """A command that ends with one line and exit code 2 on bad input.

    Args:
        line: what may be on its command line.
        schemas: by the name that its file gives them; asked for when the settings are composed.
        has_folder: whether it works in an output folder, which is then claimed and finished.
    """

    def decorate(task: Task) -> Callable[[], None]:
        @functools.wraps(task)
        def entry() -> None:
            words = sys.argv[1:]
            if "--version" in words:
                say(VERSION)
            elif words and words[0] in _COMPLETION:
                from auv_torchrl.command.completion import answer

                with ending(line.name):
                    answer(f"auv-{line.name}", line.keys, words)
            elif {"-h", "--help"} & set(words):
                say(help_of(line))
            else:
                with ending(line.name):
                    _start(line, words, schemas, task, has_folder)

        return entry

    return decorate


def help_of(line: CommandLine) -> str:
    """What ``--help`` says: the text of the command's file, ``$VEHICLES`` in it as the names there are."""
    shown = []
    for text in line.content["help"].rstrip("\n").split("\n"):
        group = text.strip().removeprefix("$").lower().removesuffix("s")
        if text.strip().startswith("$"):
            indent = " " * (len(text) - len(text.lstrip()))
            listed = ", ".join(config_names(group))
            text = textwrap.fill(listed, 120, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
        shown.append(text)
    return "\n".join(shown)


def _start(line: CommandLine, words: Sequence[str], schemas: Schemas, task: Task, has_folder: bool) -> None:
    from omegaconf import OmegaConf

    from auv_torchrl.command.arguments import quote_files, without_config_dir
    from auv_torchrl.command.compose import compose
    from auv_torchrl.command.own_files import own_files
    from auv_torchrl.command.terminal import prepare_terminal

    prepare_terminal()
    words, own = without_config_dir(words)
    with terminable(), own_files(own), on_cluster():
        shown = next((words.index(flag) for flag in _SHOW if flag in words), None)
        if shown is not None:
            words = [*words[:shown], *words[shown + 2 :]]
        overrides = quote_files(line.overrides(words), line.files)
        composed = compose(line.name, overrides, schemas(), line.groups)
        if shown is not None:
            say(OmegaConf.to_yaml(composed.config).rstrip())
            return
        folder = _folder(line.name, composed.config) if has_folder else Path.cwd()
        run = Run(folder, tuple(overrides), composed.choices)
        with _claimed(line.name, composed.config, run) if has_folder else _logging(None):
            task(composed.config, run)


def _folder(name: str, config: "DictConfig") -> Path:
    from omegaconf import OmegaConf

    if not OmegaConf.is_missing(config, "output"):
        return Path(config.output)
    return Path("outputs", name, datetime.now().strftime("%Y-%m-%d_%H-%M-%S"))


@contextmanager
def _claimed(name: str, config: "DictConfig", run: Run) -> Iterator[None]:
    """Hold the folder while the command works in it; a refused command leaves none behind."""
    from auv_torchrl.command.folder import claim_folder, discard_start, finish, leave

    with writing():
        claim_folder(run.folder, name, _settings(config), list(run.overrides))
    try:
        with _logging(run.folder / f"{name}.log"), writing():
            _say_if_it_goes_on(run.folder)
            yield
            finish(run.folder)
    except BadInput as error:
        if error.code == BAD_INPUT:
            discard_start(run.folder, name)
        raise
    finally:
        leave(run.folder)


def _settings(config: "DictConfig") -> str:
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        return OmegaConf.to_yaml(config, resolve=True)
    except OmegaConfBaseException as error:
        why = str(error).split("\n    full_key")[0]
        raise BadInput(one_line(f"{error.full_key}: {why}")) from error


def _say_if_it_goes_on(folder: Path) -> None:
    import logging

    from auv_torchrl.command.folder import goes_on

    if goes_on(folder):
        logging.getLogger(__name__).info("going on with the unfinished run in %s", folder)


@contextmanager
def _logging(file: Path | None) -> Iterator[None]:
    """Plain lines on the console, and the same with time and origin in a file."""
    import logging

    from auv_torchrl.command.terminal import Console, LogFile

    handlers: list[logging.Handler] = [Console(sys.stdout)]
    handlers[0].setFormatter(logging.Formatter("%(message)s"))
    if file is not None:
        handlers.append(LogFile(file, encoding="utf-8"))
        handlers[1].setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    root = logging.getLogger()
    before = root.level
    root.setLevel(logging.INFO)
    for handler in handlers:
        root.addHandler(handler)
    try:
        with writing():
            yield
    finally:
        root.setLevel(before)
        for handler in handlers:
            root.removeHandler(handler)
            handler.close()
