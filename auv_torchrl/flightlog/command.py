"""The command ``auv-log``: say what is in a log, or convert it to the simple form."""

import io
import sys
from collections.abc import Iterator, Sequence
from glob import glob
from os.path import exists
from pathlib import Path
from typing import NoReturn

from auv_torchrl import __version__
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.paths import config_names
from auv_torchrl.settings import choices
from auv_torchrl.text import printable

_BAD_INPUT = 2  # exit code, as for a wrong command line
_ACTIONS = ("info", "convert")
_KEYS = ("output", "modes", "params", "system", "mapping", "replace", "healthy", "vehicle")
FORMATS = (
    "ArduPilot DataFlash log, ArduPilot DataFlash log as text, PX4 log, MCAP recording, ROS bag, MAVLink telemetry; "
    "CSV and Parquet"
)
HELP = f"""What is in a log of a vehicle, and the same in the simple form that auv-diagnose reads too.

  auv-log info FILE ...                   streams, rates and gaps, frame, motors, modes, arming, what can be diagnosed
  auv-log convert FILE --output log.csv   one table with commands, pose and rates; also --output log.parquet

  --healthy FILE    of info: a flight while the vehicle was sound; parameters that differ from it are named
  --vehicle NAME    of info: read a table as a diagnosis of this vehicle does
  --params FILE     parameters that the log lacks, as a ground station saves them; or {{MOT_1_DIRECTION: -1}}
  --mapping FILE    what the columns of a table or the messages of a recording are, where their names do not say it
  --modes [MANUAL]  take these modes alone
  --system 1        which vehicle, where a file has several
  --replace         write over the output

Any of them may also be given as name=value: healthy=FILE, replace=true. auv-log FILE is auv-log info FILE.
eval "$(auv-log --completion bash)", or zsh, lets the Tab key complete names.

Formats: {FORMATS}"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends with one line and exit code 2 on bad input."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files on a terminal without Unicode
    if given and given[0] in ("--completion", "--complete"):
        return _complete(given)
    if not given or given[0] == "help" or {"-h", "--help"} & set(given):
        print(HELP)
        return
    if "--version" in given:
        print(f"auv_torchrl {__version__}")
        return
    try:
        action, files, keys = _parsed(given)
        from auv_torchrl.flightlog.streams.options import read_options  # here, not above: --help needs nothing of it

        modes = [mode.strip() for mode in keys.get("modes", "").strip("[]").split(",") if mode.strip()]
        options = read_options(modes, keys.get("params"), keys.get("system"), keys.get("mapping"))
        from auv_torchrl.flightlog.job import convert, info  # here: nor does a mistaken line

        if action == "info":
            info(files, options, keys.get("healthy", ""), keys.get("vehicle", ""))
        else:
            convert(files, options, keys)
    except (FlightLogError, FileExistsError) as error:
        _fail(str(error))
    except OSError as error:
        _fail(f"{error.filename or 'the output'}: {error.strerror or error}")
    except KeyboardInterrupt:
        _fail("interrupted; nothing was written")


def _complete(given: list[str]) -> None:
    from auv_torchrl.command.completion import answer
    from auv_torchrl.command.errors import BadInput

    keys = {f"--{key}": config_names(key) if key == "vehicle" else [] for key in _KEYS}
    try:
        answer("auv-log", {**keys, "--help": [], "--version": []}, given)
    except BadInput as error:
        _fail(str(error))


def _parsed(given: list[str]) -> tuple[str, list[Path], dict[str, str]]:
    action, *rest = given if given[0] in _ACTIONS or not exists(given[0]) else ["info", *given]
    if action not in _ACTIONS:
        raise FlightLogError(f"{action!r} is none of info, convert: see auv-log --help")
    keys: dict[str, str] = {}
    files: list[Path] = []
    words = iter(rest)
    for word in words:
        key, sign, value = word.partition("=")
        if word.startswith("--"):
            keys[_option(key)] = value if sign else _value(_option(key), words)
        elif sign and key in _KEYS:
            keys[key] = value
        elif sign and not exists(word):
            raise FlightLogError(
                f"{word!r}: there is no file of that name and no key {key!r}: keys are {', '.join(_KEYS)}"
            )
        else:  # a pattern is what a shell has left, as that of Windows does
            files += map(Path, (not exists(word) and sorted(glob(word))) or [word])
    if not files:
        raise FlightLogError(f"give a log: auv-log {action} FILE")
    return action, files, keys


def _option(word: str) -> str:
    key = word.removeprefix("--")
    if key not in _KEYS:
        raise FlightLogError(f"{word}: there is no such option: {choices([word], [f'--{key}' for key in _KEYS])}")
    return key


def _value(key: str, words: Iterator[str]) -> str:
    """What follows an option; ``--replace`` stands alone."""
    if key == "replace":
        return "true"
    value = next(words, "")
    if not value or value.startswith("--"):
        raise FlightLogError(f"--{key} needs a value: see auv-log --help")
    return value


def _fail(message: str) -> NoReturn:
    sys.stderr.write(f"auv-log: {printable(' '.join(message.split()), None)}\n")
    sys.exit(_BAD_INPUT)


if __name__ == "__main__":
    main()
