"""The notebook of examples/: kept as it was executed, and executed small."""

import json

import pytest

from auv_torchrl.paths import PROJECT

NOTEBOOK = PROJECT / "examples" / "break_and_adapt.ipynb"
SMALL = {"TRANSITIONS": "800", "STARTS": "2"}


def outputs(notebook):
    return [output for cell in notebook["cells"] for output in cell.get("outputs", [])]


def test_the_notebook_is_kept_with_its_pictures():
    """What a reader sees without running it: three pictures, and no error."""
    kept = outputs(json.loads(NOTEBOOK.read_text()))
    assert sum("image/png" in output.get("data", {}) for output in kept) == 3
    assert all(output["output_type"] != "error" for output in kept)
    assert NOTEBOOK.stat().st_size < 500_000


@pytest.mark.slow
def test_the_notebook_runs(tmp_path, monkeypatch):
    """From the first cell to the last, with a small training, each flight says how far from the target it is."""
    nbclient = pytest.importorskip("nbclient", reason="pip install nbclient ipykernel")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel", reason="pip install ipykernel")
    for name, value in {**SMALL, "POLICIES": str(tmp_path), "PYTHONPATH": str(PROJECT)}.items():
        monkeypatch.setenv(name, value)
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, kernel_name="python3").execute()
    said = "".join(output.get("text", "") for output in outputs(notebook))
    assert all(f"{name}: " in said for name in ("healthy", "broken", "adapted", "alarms"))
