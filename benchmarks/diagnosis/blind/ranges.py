"""Reads `ranges.yaml`, the only place that says what is concealed and how strong."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml


@cache
def ranges() -> dict[str, Any]:
    return yaml.safe_load((Path(__file__).parent / "ranges.yaml").read_text())


def entry(*path: str) -> dict[str, Any]:
    found = ranges()
    for key in path:
        found = found[key]
    return found


def limits(*path: str) -> tuple[float, float]:
    low, high = entry(*path)["range"]
    return low, high


def draw(rng: np.random.Generator, *path: str) -> Any:
    """One value: uniform in a range, log-uniform where the range says so, or one of the choices."""
    found = entry(*path)
    if "choices" in found:
        return found["choices"][rng.integers(len(found["choices"]))]
    low, high = found["range"]
    if found.get("scale") == "log":
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
