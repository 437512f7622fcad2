"""The command ``auv-log``: say what is in a log, or convert it to the simple form."""

import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from auv_torchrl import __version__
from auv_torchrl.flightlog.findings import FlightLogError
from auv_torchrl.flightlog.readers import READERS
from auv_torchrl.flightlog.streams.options import read_options
from auv_torchrl.text import printable

_BAD_INPUT = 2  # exit code, as for a wrong command line
_KEYS = ("output", "modes", "params", "system", "mapping", "replace", "healthy", "vehicle")
HELP = """What is in a log of a vehicle, and the same in the simple form that diagnose.py reads too.

  auv-log info FILE [FILE ...]           streams, rates and gaps, frame, motors, modes, arming, what can be diagnosed
  auv-log convert FILE output=log.csv    one table with commands, pose and rates; also output=log.parquet

  healthy=FILE      of info: a flight while the vehicle was sound; parameters that differ from it are named
  vehicle=NAME      of info: read a table as a diagnosis of this vehicle does
  params=FILE       parameters that the log lacks, as a ground station saves them; or params={MOT_1_DIRECTION: -1}
  mapping=FILE      what the columns of a table or the messages of a recording are, where its names do not say it
  modes=[MANUAL]    take these modes alone
  system=1          which vehicle, where a file has several
  replace=true      write over the output

Formats: """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; ends with one line and exit code 2 on bad input."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # names of files on a terminal without Unicode
    if not given or given[0] == "help" or {"-h", "--help"} & set(given):
        print(f"{HELP}{', '.join(READERS)}; CSV and Parquet")
        return
    if "--version" in given:
        print(f"auv_torchrl {__version__}")
        return
    try:
        action, files, keys = _parsed(given)
        modes = [mode.strip() for mode in keys.get("modes", "").strip("[]").split(",") if mode.strip()]
        options = read_options(modes, keys.get("params"), keys.get("system"), keys.get("mapping"))
        from auv_torchrl.flightlog.job import convert, info  # here, not above: --help needs nothing of it

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


def _parsed(given: list[str]) -> tuple[str, list[Path], dict[str, str]]:
    action, *rest = given
    if action not in ("info", "convert"):
        raise FlightLogError(f"{action!r} is none of info, convert: see auv-log --help")
    keys = {}
    files = []
    for word in rest:
        key, sign, value = word.partition("=")
        if sign and key in _KEYS:
            keys[key] = value
        elif sign and not Path(word).exists():
            raise FlightLogError(
                f"{word!r}: there is no file of that name and no key {key!r}: keys are {', '.join(_KEYS)}"
            )
        else:
            files.append(Path(word))
    if not files:
        raise FlightLogError(f"give a log: auv-log {action} FILE")
    return action, files, keys


def _fail(message: str) -> NoReturn:
    sys.stderr.write(f"auv-log: {printable(' '.join(message.split()), None)}\n")
    sys.exit(_BAD_INPUT)


if __name__ == "__main__":
    main()
