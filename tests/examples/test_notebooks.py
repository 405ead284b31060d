"""The code of every notebook, cell by cell, as it stands there."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from processes import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_its_first_cell_to_its_last(notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    names: dict[str, object] = {}
    cells = [each for each in json.loads(notebook.read_text())["cells"] if each["cell_type"] == "code"]
    for number, cell in enumerate(cells):
        assert cell["outputs"] == [], "notebooks are kept without their output"
        exec(compile("".join(cell["source"]), f"{notebook.name}, cell {number}", "exec"), names)  # noqa: S102
