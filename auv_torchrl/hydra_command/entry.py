"""What stands around a command that Hydra reads: ``hydra.main``, and an end of one line whatever happens."""

import functools
import logging
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from string import Template
from types import MappingProxyType

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from auv_torchrl.command.arguments import quote_files, refuse_unknown_keys, spelt_out, without_config_dir
from auv_torchrl.command.ending import VERSION, ending, on_cluster, say, terminable
from auv_torchrl.command.errors import BAD_INPUT, BadInput, fail, writing
from auv_torchrl.command.folder import discard_start, finish, is_finished, leave
from auv_torchrl.command.own_files import own_files
from auv_torchrl.command.terminal import prepare_terminal
from auv_torchrl.hydra_command.config_source import check_config_files
from auv_torchrl.hydra_command.explain import composed, explain
from auv_torchrl.paths import CONF, config_names
from auv_torchrl.yaml_file import read_yaml

log = logging.getLogger(__name__)


# long: Hydra's task and the entry point around it share what the command was given
def hydra_command(
    config_name: str,
    files: tuple[str, ...] = ("output",),
    groups: tuple[str, ...] = (),
    short: Mapping[str, str] = MappingProxyType({}),
    register: Callable[[], None] = lambda: None,
    has_folder: bool = True,
) -> Callable[[Callable[[DictConfig], None]], Callable[[], None]]:
    """``hydra.main`` on ``conf/<config_name>.yaml`` that ends with one line and exit code 2 on bad input.

    Args:
        config_name: of the command.
        files: keys whose values name files or folders.
        groups: folders of ``conf`` from which ``+group=option`` may add something.
        register: makes schemas known to Hydra, those of one's own files included; may be called again.
        has_folder: whether it works in an output folder, which is then claimed and finished.
        short: other names of keys: ``{"diagnosis": "diagnosis_file"}`` lets people write ``diagnosis=FILE``.
    """

    def decorate(task: Callable[[DictConfig], None]) -> Callable[[], None]:
        @functools.wraps(task)
        def job(config: DictConfig) -> None:
            prepare_terminal()  # here too, because jobs of a sweep may run in processes of their own
            folder = Path(HydraConfig.get().runtime.output_dir)
            if has_folder and is_finished(folder):  # in a sweep that goes on
                log.info("finished before: %s", folder)
                return
            try:
                with writing():
                    register()  # here too, because of the resolvers
                    task(config)
                    finish(folder)  # nothing where this process holds none
            except BadInput as error:
                if HydraConfig.get().mode is RunMode.MULTIRUN:
                    raise  # the other jobs of the sweep go on; Hydra reports this one when they are done
                if has_folder and error.code == BAD_INPUT:
                    discard_start(folder, config_name)
                fail(config_name, error)
            finally:
                leave(folder)

        hydra_main = hydra.main(version_base="1.3", config_path=str(CONF), config_name=config_name)(job)

        def entry() -> None:
            os.environ.setdefault("HYDRA_FULL_ERROR", "1")  # Hydra hands its errors on instead of printing them
            check_config_files()
            prepare_terminal()
            given = sys.argv
            try:
                arguments, own = without_config_dir(given[1:])
                with ending(config_name), terminable(), own_files(own), on_cluster():
                    if {"-h", "--help"} & set(arguments):
                        say(help_of(config_name))
                        return
                    _refuse_unchecked(arguments)
                    register()
                    sys.argv = [given[0], *quote_files(spelt_out(arguments, short), files)]
                    refuse_unknown_keys(lambda: composed(config_name), sys.argv[1:], groups)
                    hydra_main()
            except (HydraException, OmegaConfBaseException) as error:
                fail(config_name, BadInput(explain(config_name, error)))
            finally:
                sys.argv = given
                leave()

        return telling_version(entry)

    return decorate


def telling_version(entry: Callable[[], None]) -> Callable[[], None]:
    """The same, but ``--version`` is answered with ours: Hydra would tell its own."""

    def answer() -> None:
        if "--version" in sys.argv[1:]:
            print(VERSION)
        else:
            entry()

    return answer


def _refuse_unchecked(arguments: Sequence[str]) -> None:
    for given in arguments:
        if given.lstrip("+").startswith("hydra.searchpath="):
            raise BadInput(f"{given}: what is there would not be checked: give --config-dir FOLDER")


def help_of(config_name: str) -> str:
    """What ``--help`` says: the text of the command's file with what there is to choose, or where it has none the file.

    Hydra would compose all settings first, and copy them for each group: 1.6 s.
    """
    path = CONF / f"{config_name}.yaml"
    content = read_yaml(path, "configuration", plain=False)
    if "help" not in content.get("hydra", {}):
        return path.read_text(encoding="utf-8")
    groups = sorted(path.name for path in CONF.iterdir() if path.is_dir() and path.name != "hydra")
    listed = "".join(f"{group}: {', '.join(names)}\n" for group in groups if (names := config_names(group)))
    return Template(content["hydra"]["help"]["template"]).substitute(APP_CONFIG_GROUPS=listed)
