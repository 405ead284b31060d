from dataclasses import dataclass
from pathlib import Path

import pytest

from benchmarks.diagnosis.blind.generate import generate


@dataclass(frozen=True)
class GeneratedSet:
    cases: Path
    sealed: Path
    seal: str


@pytest.fixture(scope="session")
def generated(tmp_path_factory) -> GeneratedSet:
    """The first three of the short suite: a null, a viscoelasticity, swapped triangles beside a simulation."""
    folder = tmp_path_factory.mktemp("blind")
    seal = generate(seed=11, suite="bench", n=3, out=folder / "cases", sealed=folder / "sealed")
    return GeneratedSet(folder / "cases", folder / "sealed", seal)
