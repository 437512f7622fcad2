"""The Tab key: a script for the shell, and what the command answers when the shell asks.

``eval "$(auv-diagnose --completion bash)"`` installs it; zsh and fish likewise. The shell then hands the line so far to
``auv-diagnose --complete``, and completes names of files by itself where nothing is answered.
"""

from collections.abc import Mapping, Sequence

from auv_torchrl.command.errors import BadInput

_BASH = """_{name}() {{
    local IFS=$'\\n'
    COMPREPLY=($({command} --complete bash "${{COMP_LINE:0:COMP_POINT}}" 2>/dev/null))
    [[ ${{COMPREPLY[0]}} == *= ]] && compopt -o nospace
}}
complete -o default -F _{name} {command}"""
_ZSH = """_{name}() {{
    local -a found
    found=("${{(@f)$({command} --complete zsh "${{LBUFFER}}" 2>/dev/null)}}")
    [[ -n ${{found[1]}} ]] && compadd -Q -S '' -- $found || _files
}}
compdef _{name} {command}"""
_FISH = "complete -c {command} -a '({command} --complete fish (commandline -cp))'"
_NO_SETTINGS = ("--help", "--version")
SCRIPTS = {"bash": _BASH, "zsh": _ZSH, "fish": _FISH}


def answer(command: str, keys: Mapping[str, Sequence[str]], words: Sequence[str]) -> None:
    """Print the script of a shell (``--completion bash``), or what completes a line (``--complete bash LINE``).

    Args:
        command: its name.
        keys: by option, ``--vehicle``, what there is to choose; nothing for files, numbers and words.
        words: of the command line.

    Raises:
        BadInput: for a shell that is none of these.
    """
    shell = words[1] if len(words) > 1 else ""
    if shell not in SCRIPTS:
        raise BadInput(f"{words[0]} {shell}: give one of {', '.join(SCRIPTS)}")
    if words[0] == "--completion":
        print(SCRIPTS[shell].format(command=command, name=command.replace("-", "_")))
        return
    for found in candidates(keys, words[2] if len(words) > 2 else "", whole=shell != "bash"):
        print(found)


def candidates(keys: Mapping[str, Sequence[str]], line: str, whole: bool = True) -> list[str]:
    """What the last word of a line may become.

    Args:
        keys: by option, what there is to choose.
        line: up to the cursor.
        whole: whether the whole word is wanted: bash takes a word apart at ``=`` and wants what comes after it.
    """
    words = line.split(" ")
    last, before = words[-1], words[-2] if len(words) > 1 else ""
    if (sign := last.find("=")) >= 0:
        key = last[:sign].lstrip("+")
        option = key if key.startswith("--") else f"--{key}".replace("_", "-")
        found = [name for name in keys.get(option, ()) if name.startswith(last[sign + 1 :])]
        return [f"{last[: sign + 1]}{name}" if whole else name for name in found]
    if chosen := keys.get(before):
        return [name for name in chosen if name.startswith(last)]
    if last.startswith("-"):
        return [option for option in keys if option.startswith(last)]
    if not last:
        return []  # the shell proposes files
    settings = [option[2:].replace("-", "_") for option in keys if option not in _NO_SETTINGS]
    return [f"{name}=" for name in settings if name.startswith(last)]
