"""docs/promises.md: every line names what shows it, and that exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXT = (ROOT / "docs" / "promises.md").read_text()
NAMED = re.compile(r"`((?:tests|benchmarks|systemd|fuzz)/[^`]+)`")
LINES = [line for line in TEXT.splitlines() if line.startswith("| ") and not line.endswith("shown by |")]


@pytest.mark.parametrize("line", LINES, ids=lambda line: line[2:50])
def test_every_promise_is_shown_by_something(line):
    assert NAMED.search(line.rsplit("|", 2)[1]), "the last column names a test or a program"


@pytest.mark.parametrize("name", sorted(set(NAMED.findall(TEXT))))
def test_the_named_tests_and_programs_exist(name):
    path, _, function = name.partition("::")
    assert (ROOT / path).exists()
    if function:
        tree = ast.parse((ROOT / path).read_text())
        assert function in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_the_page_of_guarantees_is_not_empty():
    assert len(LINES) > 40
