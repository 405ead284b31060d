"""Every line of long.txt names tests that exist."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LINES = [line for line in (ROOT / "tests" / "long.txt").read_text().splitlines() if line and not line.startswith("#")]


def exists(line: str) -> bool:
    path, _, name = line.partition("::")
    file = ROOT / path
    return file.exists() and (not name or f"def {name.partition('[')[0]}" in file.read_text())


def test_long_tests_exist() -> None:
    assert [line for line in LINES if not exists(line)] == []
    assert len(LINES) > 100
