"""Reads `ranges.yaml`, the only file with the ranges of all that is concealed."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml


@cache
def ranges() -> dict[str, Any]:
    """Content of `ranges.yaml`."""
    return yaml.safe_load((Path(__file__).parent / "ranges.yaml").read_text())


def entry(*path: str) -> dict[str, Any]:
    """The entry at a path of keys, for example `entry("effects", "creep", "a")`."""
    node = ranges()
    for key in path:
        node = node[key]
    return node


def limits(*path: str) -> tuple[float, float]:
    """The two ends of an entry's range."""
    low, high = entry(*path)["range"]
    return low, high


def draw(rng: np.random.Generator, *path: str) -> Any:
    """Draw one value of an entry: uniform, log-uniform for `scale: log`, or one of `choices`."""
    node = entry(*path)
    if "choices" in node:
        return node["choices"][rng.integers(len(node["choices"]))]
    low, high = node["range"]
    if node.get("scale") == "log":
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
