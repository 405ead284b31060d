"""Every line of long.txt names tests that exist."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LINES = [line for line in (ROOT / "tests" / "long.txt").read_text().splitlines() if line and not line.startswith("#")]


@pytest.mark.parametrize("line", LINES)
def test_a_long_test_exists(line: str) -> None:
    path, _, name = line.partition("::")
    assert (ROOT / path).exists()
    if name:
        assert f"def {name.partition('[')[0]}" in (ROOT / path).read_text()
