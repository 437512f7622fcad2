"""The files that a diagnosis leaves in its folder."""

import json
import logging
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from auv_torchrl.diagnosis.conclude.findings import to_change
from auv_torchrl.diagnosis.scenario_file import alternatives_yaml, randomization_yaml, scenario_yaml
from auv_torchrl.diagnosis.verdict import Diagnosis, Window, to_json
from auv_torchrl.extras import command, is_installed
from auv_torchrl.files import encoded, write_whole
from auv_torchrl.flightlog import POSE, VELOCITY
from auv_torchrl.flightlog.tables.csv_text import csv_blocks
from auv_torchrl.quantities import series
from auv_torchrl.vehicle import Vehicle

log = logging.getLogger("diagnose")
_PARAMETER = re.compile(r"[A-Z][A-Z0-9_]{0,15}")  # of ArduPilot: a name that is none writes no line of its own
RECORDING = "diagnosis.rrd"
_FOR_PROGRAMS = ("randomization.yaml", "predictions.parquet", RECORDING)


def write_files(diagnosis: Diagnosis, vehicle: Vehicle, folder: Path, replace: bool = False) -> list[Path]:
    """Write diagnosis.json, report.html, scenario.yaml and what goes with them; each appears complete or not at all.

    ``alternative_1.yaml`` and so on hold the other explanations that the log leaves open.

    Args:
        diagnosis: what to write.
        vehicle: the nominal vehicle, no batch.
        folder: where to.
        replace: files of these names, as where an earlier run was broken off; otherwise there must be none.

    Returns:
        The files, in the order in which people look at them.

    Raises:
        FileExistsError: if one is there already and is not to be replaced.
    """
    from auv_torchrl.diagnosis.report.page import report_page  # here: jinja2 is not needed before the work is done

    answer = json.dumps(to_json(diagnosis), indent=2, ensure_ascii=False, allow_nan=False)
    contents = {
        "report.html": encoded(report_page(diagnosis, vehicle)),
        "diagnosis.json": encoded(answer + "\n"),
        "scenario.yaml": encoded(scenario_yaml(diagnosis, vehicle)),
        "randomization.yaml": encoded(randomization_yaml(diagnosis, vehicle)),
    }
    others = alternatives_yaml(diagnosis, vehicle)
    contents |= {f"alternative_{i}.yaml": encoded(text) for i, text in enumerate(others, start=1)}
    if is_installed("pyarrow"):
        contents["predictions.parquet"] = _parquet(predictions(diagnosis.windows))
    else:
        log.info("predictions.parquet is left out, pyarrow is not installed: %s", command("logs"))
    change = {name: value for name, value in to_change(diagnosis).items() if _PARAMETER.fullmatch(name)}
    if change:
        contents["advice.param"] = encoded("".join(f"{name},{value:g}\n" for name, value in change.items()))
    experiment = diagnosis.next_experiment
    if experiment is not None and experiment.t is not None and experiment.thruster_commands is not None:
        commands = {"t": experiment.t}
        commands |= {f"cmd_{i + 1}": c for i, c in enumerate(experiment.thruster_commands.T)}
        contents[experiment.commands] = b"".join(csv_blocks(commands))
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / name for name in contents]
    recorded = folder / RECORDING if is_installed("rerun") else None
    if recorded:
        paths.append(recorded)
    else:
        log.info("%s is left out, rerun is not installed: %s", RECORDING, command("rerun"))
    for path in paths:
        if path.exists() and not replace:
            raise FileExistsError(f"{path} exists: give another output folder or delete it")
    for name, content in contents.items():
        write_whole(folder / name, content)
    if recorded:
        from auv_torchrl.diagnosis.report.recording import record_diagnosis  # here, not above: it needs rerun

        record_diagnosis(diagnosis, vehicle, recorded)
    return paths


def named_files(paths: Iterable[Path]) -> str:
    """Of the files of :func:`write_files`, the names of those that people open, load or fly."""
    return series(path.name for path in paths if path.name not in _FOR_PROGRAMS)


def predictions(windows: tuple[Window, ...]) -> dict[str, np.ndarray]:
    """Held-out windows, one row per sample: window, episode, t, commands, then measured, before and after by axis."""
    columns: dict[str, list[np.ndarray]] = {}

    def add(name: str, values: np.ndarray) -> None:
        columns.setdefault(name, []).append(values)

    for number, window in enumerate(windows):
        length = len(window.t)
        add("window", np.full(length, number))
        add("episode", np.full(length, window.episode))
        add("t", window.t)
        for i in range(window.commands.shape[1]):
            add(f"cmd_{i + 1}", window.commands[:, i])
        for kind in ("measured", "before", "after"):
            values = getattr(window, kind).values
            for i, axis in enumerate((*POSE, *VELOCITY)):
                add(f"{kind}_{axis}", values[:, i])
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def _parquet(columns: Mapping[str, np.ndarray]) -> bytes:
    """The columns as Parquet, as they lie in memory: ``pa.array`` asks pandas first, which takes 0.15 s to import."""
    import pyarrow as pa  # here, not above: it need not be installed
    from pyarrow import parquet

    def column(values: np.ndarray) -> pa.Array:
        return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, pa.py_buffer(values)])

    stream = pa.BufferOutputStream()
    parquet.write_table(pa.table({name: column(values) for name, values in columns.items()}), stream)
    return stream.getvalue().to_pybytes()
