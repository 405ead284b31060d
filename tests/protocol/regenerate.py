"""Writes what is expected of the golden logs, as the oracle reads them, into protocol/golden.

    python tests/protocol/regenerate.py           the expected values, from the logs that are there
    python tests/protocol/regenerate.py --logs    the logs and layouts too, from the emulator

Look at the difference before you commit it: the golden files are the contract.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import oracle

GOLDEN = oracle.PROTOCOL / "golden"
FORMAT = "insole-golden/1"
SETTINGS = {
    "rate_hz": 50.0,
    "slack_ms": 5.0,
    "stale_after_ms": 200.0,
    "activation_threshold_count": 0.0,
    "min_force_n": 20.0,
    "min_pressure_pa": 20000.0,
}


def compact(value: Any) -> Any:
    """Numbers as short as they can be: whole ones without a point, others to 9 digits."""
    if isinstance(value, float):
        return int(value) if value.is_integer() else float(f"{value:.9g}")
    if isinstance(value, dict):
        return {key: compact(item) for key, item in value.items()}
    return [compact(item) for item in value] if isinstance(value, list) else value


def line(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"))


def members(of: dict[str, Any]) -> str:
    return ",\n".join(f'"{key}":{line(value)}' for key, value in of.items())


def text(head: dict[str, Any], content: dict[str, Any]) -> str:
    """A golden file: one line a cycle."""
    feet = []
    for foot in content["feet"]:
        cycles = ",\n".join(line(compact(cycle)) for cycle in foot["cycles"])
        others = {key: value for key, value in foot.items() if key != "cycles"}
        feet.append(f'{{{members(others)},\n"cycles":[\n{cycles}\n]}}')
    return f'{{{members(head | {"refused": content["refused"]})},\n"feet":[\n' + ",\n".join(feet) + "\n]}\n"


def expected(log: Path, about: str, settings: dict[str, float], insoles: list[dict[str, Any]]) -> str:
    """The golden file of `log`."""
    head = {"format": FORMAT, "about": about, "log": log.name, "settings": settings}
    return text(head, oracle.read(log, settings, insoles))


def main(arguments: list[str]) -> None:
    if arguments not in ([], ["--logs"]):
        raise SystemExit(__doc__)
    from logs import cases, layout_yaml

    GOLDEN.mkdir(exist_ok=True)
    if arguments:
        for foot in ("left", "right"):
            (GOLDEN / f"{foot}.yaml").write_text(layout_yaml(foot))
    for name, case in cases().items():
        log = GOLDEN / f"{name}.log"
        if arguments:
            log.write_text("".join(frame.line() for frame in case.make()))
        (GOLDEN / f"{name}.json").write_text(expected(log, case.about, SETTINGS, case.as_golden()))


if __name__ == "__main__":
    main(sys.argv[1:])
