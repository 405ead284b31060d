from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.blind.generate import generate


@dataclass(frozen=True)
class Made:
    cases: Path
    sealed: Path
    seal: str


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> Made:
    """Three short-suite cases: two nulls and a hysteresis."""
    folder = tmp_path_factory.mktemp("blind")
    seal = generate(seed=11, suite="bench", n=3, out=folder / "cases", sealed=folder / "sealed", jobs=1)
    return Made(folder / "cases", folder / "sealed", seal)
