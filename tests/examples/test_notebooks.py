"""The code of every notebook, cell by cell, as it stands there."""

from __future__ import annotations

import ast
import json
import os
from xml.etree import ElementTree

import pytest
from processes import ROOT

NOTEBOOKS = ROOT / "docs" / "notebooks"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs a notebook from its first cell to its last: (its names, the drawings it shows)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", os.defpath)  # Jupyter may run in an environment that is not activated

    def run(notebook):
        names, drawings = {}, []
        document = json.loads((NOTEBOOKS / notebook).read_text())
        cells = [cell for cell in document["cells"] if cell["cell_type"] == "code"]
        for number, cell in enumerate(cells):
            assert cell["outputs"] == [], "notebooks are kept without their output"
            *statements, last = ast.parse("".join(cell["source"])).body
            where = f"{notebook}, cell {number}"
            exec(compile(ast.Module(statements, []), where, "exec"), names)  # noqa: S102
            if isinstance(last, ast.Expr):
                shown = eval(compile(ast.Expression(last.value), where, "eval"), names)  # noqa: S307
                if hasattr(shown, "_repr_svg_"):
                    drawings.append(ElementTree.fromstring(shown._repr_svg_()))
            else:
                exec(compile(ast.Module([last], []), where, "exec"), names)  # noqa: S102
        return names, drawings

    return run


def test_first_look(run):
    names, drawings = run("first-look.ipynb")
    assert len(names["table"]) > 20
    assert abs(names["index"].value) < 10
    assert len(drawings) == 2


def test_calibrate_and_validate(run):
    names, drawings = run("calibrate-and-validate.ipynb")
    assert names["outcome"].f_z.accuracy > 90
    assert len(drawings) == 2


def test_find_missing_physics(run):
    names, drawings = run("find-missing-physics.ipynb")
    assert [finding.effect for finding in names["diagnosis"].findings] == ["viscoelasticity"]
    assert names["verified"].after < names["verified"].before / 2
    assert len(drawings) == 1


def test_every_notebook_is_run_here():
    assert {path.name for path in NOTEBOOKS.glob("*.ipynb")} == {
        "first-look.ipynb", "calibrate-and-validate.ipynb", "find-missing-physics.ipynb"
    }  # fmt: skip
