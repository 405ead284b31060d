"""Lists the benchmarks and runs them.

    python -m benchmarks list                                  every benchmark: what it measures, how long it takes
    python -m benchmarks run NAME [ARGUMENTS...]               one of them, for example live.full_load --rounds 2
    python -m benchmarks run SUITE                             all of a suite, one after the other

A benchmark is a module of a suite whose docstring has a line "Takes …". Its first line says what it measures.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent
_TAKES = re.compile(r"^Takes (.+?)\.?$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A module that measures something."""

    name: str  # suite.module
    measures: str
    takes: str


def benchmarks() -> list[Benchmark]:
    """Return every benchmark, by suite and name; reads the modules without importing them."""
    listed = []
    for path in sorted(FOLDER.glob("*/**/*.py")):
        docstring = ast.get_docstring(ast.parse(path.read_text())) or ""
        takes = _TAKES.search(docstring)
        if takes:
            module = path.relative_to(FOLDER).with_suffix("").parts
            name = ".".join(module[:-1] if module[-1] == "__main__" else module)
            listed.append(Benchmark(name, docstring.split("\n")[0].rstrip("."), takes[1]))
    return listed


def main() -> int:
    """Return the exit status: 0, or that of the first benchmark that failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("list", help="every benchmark, one line each")
    run = commands.add_parser("run", help="a benchmark, or all of a suite", add_help=False)
    run.add_argument("name", help="as `list` shows it, or a suite such as live")
    options, arguments = parser.parse_known_args()
    every = benchmarks()
    if options.command == "list":
        if arguments:
            parser.error(f"list takes no arguments, found {' '.join(arguments)}")
        width = max(len(benchmark.name) for benchmark in every)
        for benchmark in every:
            print(f"{benchmark.name:{width}}  {benchmark.measures} [{benchmark.takes}]")
        return 0
    chosen = [benchmark for benchmark in every if options.name in (benchmark.name, benchmark.name.split(".")[0])]
    if not chosen:
        parser.error(f"no benchmark is named {options.name!r}; `python -m benchmarks list` shows the names")
    if len(chosen) > 1 and arguments:
        parser.error(f"arguments are for one benchmark, and {options.name} is a suite of {len(chosen)}")
    for benchmark in chosen:
        print(f"=== {benchmark.name}: {benchmark.measures} [{benchmark.takes}]", file=sys.stderr, flush=True)
        command = [sys.executable, "-m", f"benchmarks.{benchmark.name}", *arguments]
        status = subprocess.run(command, cwd=FOLDER.parent, check=False).returncode
        if status:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
