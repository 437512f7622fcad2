"""A folder of one's own: vehicles, scenarios, effects and so on that are in no package."""

from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path

from auv_torchrl.command.errors import checking_input
from auv_torchrl.environment import environment
from auv_torchrl.paths import CONF, OWN, config_path, own_folder
from auv_torchrl.registry import PYTHON_FOLDERS, read_all


@contextmanager
def own_files(folder: str | None) -> Iterator[None]:
    """Use a folder of one's own, checked, in place of the one that ``AUV_CONF`` names; None keeps that.

    Raises:
        BadInput: if it is none, holds a name that the package has, or Python that cannot be read.
    """
    with environment(**{} if folder is None else {OWN: folder}):  # processes of a sweep read it there
        with checking_input():
            if (own := own_folder()) is not None or folder is not None:
                _check(own, folder)
            read_all()
        yield


def _check(own: Path | None, given: str | None) -> None:
    groups = sorted([*(path.name for path in CONF.iterdir() if path.is_dir()), *PYTHON_FOLDERS])
    wanted = "give one with folders out of " + ", ".join(groups)
    if own is None or not own.is_dir():
        raise ValueError(f"there is no folder {str(own or given)!r} for files of one's own: {wanted}")
    folders = sorted(path.name for path in own.iterdir() if path.is_dir())
    for name in folders:
        if name not in groups and (near := get_close_matches(name, groups, n=1)):
            raise ValueError(f"nothing is read from {own / name}: call it {near[0]}")
    if not set(folders) & set(groups):
        raise ValueError(f"nothing is read from {own}: {wanted}")
    for group in set(folders) & set(groups) - set(PYTHON_FOLDERS):
        for path in (own / group).glob("*.yaml"):
            if path.is_file():
                config_path(group, path.stem)  # refuses a name that is in both
