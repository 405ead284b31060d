"""One name, one meaning: a public class or function is defined in one module of the package.

A name in REASONED may have several definitions, for the reason beside it.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "insole_daemon"

REASONED = {
    "load": "every file format's module has one, and callers name the module: `layouts.load(path)`",
    "read": "as `load`, for a stream or table of a format",
    "write": "as `load`, the other way",
    "document": "a format's content as plain maps and lists, called by module as `load` is",
    "calibrate": "the verb's function, and what it calls",
    "diagnose": "the verb's function, and what it calls",
    "validate": "the verb's function, and what it calls",
    "zero": "the verb's function, and what it calls",
    "Wrench": "the quantity, and the message that carries it",
}


def repeated() -> dict[str, list[str]]:
    """The public names with more than one definition, and the modules that define them."""
    modules: dict[str, list[str]] = defaultdict(list)
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and not node.name.startswith(
                "_"
            ):
                modules[node.name].append(str(path.relative_to(PACKAGE)))
    return {name: where for name, where in modules.items() if len(where) > 1}


def test_a_new_public_name_is_defined_in_one_module() -> None:
    unexplained = {name: where for name, where in repeated().items() if name not in REASONED}
    assert unexplained == {}, "rename all but one, or state the reason in REASONED"
    assert REASONED.keys() <= repeated().keys(), "a reason without a repeated name: take it out"


def test_reasons_are_few() -> None:
    assert len(REASONED) <= 15
