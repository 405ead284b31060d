"""`python -m benchmarks`: the list names every benchmark, and what it names can be started."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def call(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "benchmarks", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_list_has_one_line_per_benchmark_with_its_time():
    lines = call("list").stdout.splitlines()
    assert len(lines) > 30
    assert len({line.split()[0] for line in lines}) == len(lines)
    assert all(line.endswith("]") for line in lines)


def test_every_module_of_a_suite_that_takes_arguments_is_listed_or_started_by_another():
    listed = {line.split()[0] for line in call("list").stdout.splitlines()}
    source = "".join(path.read_text() for path in (ROOT / "benchmarks").rglob("*.py"))
    for path in (ROOT / "benchmarks").glob("*/*.py"):
        name = f"{path.parent.name}.{path.stem}"
        if "__main__" in path.read_text():
            assert name in listed or f'"{name}"' in source, f"{path} has no line `Takes …` and nothing starts it"


def test_run_passes_arguments_on_and_returns_the_status():
    done = call("run", "faults.restart", "--help")
    assert done.returncode == 0
    assert "--rounds" in done.stdout
    assert call("run", "faults.restart", "--no-such-option").returncode == 2


def test_an_unknown_name_and_arguments_for_a_suite_are_refused():
    unknown = call("run", "fast")
    assert unknown.returncode == 2
    assert "`python -m benchmarks list` shows the names" in unknown.stderr
    assert "arguments are for one benchmark" in call("run", "live", "--rounds", "2").stderr


def test_every_module_can_be_imported():
    """What nothing else imports breaks unseen when a name of the package changes."""
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in sorted((ROOT / "benchmarks").rglob("*.py"))
        if path.stem not in ("__main__", "__init__")
    ]
    assert len(modules) > 50
    code = f"import importlib\nfor name in {modules}:\n    importlib.import_module(name)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
