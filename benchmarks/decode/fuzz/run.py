"""Coverage-guided fuzzing of every parser with atheris (libFuzzer), one process for each target.

    pip install -e '.[test,fuzz]'      # atheris has wheels for x86-64
    python -m benchmarks.decode.fuzz.run                      # every target: 10 million inputs for a byte parser, for
                                                              # others until 30 CPU minutes bring no new coverage
    python -m benchmarks.decode.fuzz.run message --minutes 5  # some targets, for so many CPU minutes each

Frames and lines of a log come many at once: there each is changed for itself, and each is an input.
What is worth keeping stays in --corpus, so that a later run goes on from there. A finding is an error that is not the
project's own, an input that takes more than 1 s of CPU, or memory that grows by more than 500 MB; it ends its target,
and the input is named. Earlier findings have tests in tests/hostile/test_fuzz_findings.py.

Takes hours: 10 million inputs for each byte parser, else until 30 CPU minutes bring nothing new.
"""

from __future__ import annotations

import argparse
import contextlib
import operator
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path
from random import Random
from types import ModuleType
from typing import Any

INPUTS = 10_000_000
QUIET_CPU_S = 30 * 60.0
LONGEST_CPU_S = 1.0
MOST_MB = 500
PLAIN = (int, str, bytes)


def main() -> int:
    """Fuzz what is asked for; 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", help="all of them, if none is named")
    parser.add_argument("--minutes", type=float, help="of CPU for each target, instead of the full run")
    parser.add_argument("--corpus", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--child", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        fuzz(asked.child, asked.corpus)
        return 0
    from benchmarks.decode.fuzz.targets import TARGETS

    print("| target | inputs | CPU min | of them without new coverage | edges | found |\n|---|---|---|---|---|---|")
    n_found = 0
    for name in asked.targets or TARGETS:
        line, bad = watched(name, asked.corpus / name, asked.minutes, TARGETS[name].byte_parser)
        n_found += bad
        print(line, flush=True)
    return int(n_found > 0)


def watched(name: str, corpus: Path, minutes: float | None, byte_parser: bool) -> tuple[str, bool]:
    """Fuzz one target in a process of its own until it has had enough; a line of the table, and whether it is bad."""
    corpus.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "benchmarks.decode.fuzz.run", "--child", name, "--corpus", str(corpus)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, errors="replace")
    assert process.stderr is not None
    inputs = edges = 0
    used_s = newest_s = 0.0
    last: list[str] = []
    enough = False
    for line in process.stderr:
        last = [*last[-30:], line]
        match = re.match(r"#(\d+)\s+(\w+)\s+(?:cov: (\d+))?", line)
        if not match:
            continue
        used_s = cpu_s(process.pid)
        if match[2] == "inputs":
            inputs = int(match[1])
        if match[2] in ("INITED", "NEW") and int(match[3] or 0) > edges:
            edges, newest_s = int(match[3] or 0), used_s
        if minutes is not None:
            enough = used_s >= 60 * minutes
        elif byte_parser:
            enough = inputs >= INPUTS
        else:
            enough = used_s - newest_s >= QUIET_CPU_S
        if enough:
            process.terminate()
            break
    process.communicate()
    if not enough:  # it ended by itself
        print("".join(last), file=sys.stderr)
    said = "nothing" if enough else f"yes, in {corpus}"
    return f"| {name} | {inputs} | {used_s / 60:.1f} | {(used_s - newest_s) / 60:.1f} | {edges} | {said} |", not enough


def cpu_s(pid: int) -> float:
    """CPU time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def fuzz(name: str, corpus: Path) -> None:
    """In the child: never returns."""
    import atheris

    with atheris.instrument_imports(include=["insole_daemon", "mcap", "can"]):
        from benchmarks.decode.fuzz.targets import TARGETS
        from insole_daemon.errors import InsoleError

        target = TARGETS[name]
        for number, seed in enumerate(target.seeds()):
            (corpus / f"seed-{number}").write_bytes(seed)
            with contextlib.suppress(InsoleError):
                target.take(seed)  # what a parser imports no sooner than it needs it is watched too

    inputs, told_s = 0, 0.0

    def one(data: bytes) -> None:
        nonlocal inputs, told_s
        if not inputs:
            _keep_no_arrays(atheris)  # now: until Fuzz() it puts its own in place
        inputs, began = inputs + (len(target.units.apart(data)) if target.units else 1), time.process_time()
        if began > told_s + 1:  # libFuzzer tells it at powers of two alone
            told_s = began  # and counts several units as one
            print(f"#{inputs}\tinputs", file=sys.stderr, flush=True)
        try:
            target.take(data or b"\0")
        except InsoleError:
            pass
        took_s = time.process_time() - began
        if took_s > LONGEST_CPU_S:
            raise TimeoutError(f"{took_s:.1f} s of CPU for {len(data)} bytes")

    def mutated(data: bytes, most_bytes: int, seed: int) -> bytes:
        """Units like those in `data`, each changed for itself."""
        units, random = target.units, Random(seed)
        assert units is not None
        given = units.apart(data)
        changed = [atheris.Mutate(random.choice(given), units.most_bytes) for _ in range(units.n)]
        return units.together(changed)[:most_bytes]

    # What is read byte by byte has small units, and so has what is tried.
    longest = 2 * max(map(len, target.seeds())) if target.byte_parser else 65536
    if target.units:
        longest = target.units.n * (target.units.most_bytes + 1)
    rss_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024 + MOST_MB
    options = [f"-artifact_prefix={corpus}/found-", f"-rss_limit_mb={rss_mb}", "-timeout=60", f"-max_len={longest}"]
    atheris.Setup([sys.argv[0], *options, str(corpus)], one, **({"custom_mutator": mutated} if target.units else {}))
    atheris.Fuzz()


def _keep_no_arrays(atheris: ModuleType) -> None:
    """What atheris 3.0 puts in the place of every comparison never lets go of a result that is an array.

    That is 5 kB an input, so such comparisons, in which it sees nothing to learn from either, go past it.
    """
    from atheris.version_dependent import CMP_OP_SHIFT_AMOUNT

    traced = atheris._trace_cmp
    operators = [getattr(operator, name) for name in ("lt", "le", "eq", "ne", "gt", "ge")]

    def compared(left: Any, right: Any, which: int, *place: Any) -> Any:
        if isinstance(left, PLAIN) and isinstance(right, PLAIN):
            return traced(left, right, which, *place)
        return operators[which >> CMP_OP_SHIFT_AMOUNT](left, right)

    atheris._trace_cmp = compared


if __name__ == "__main__":
    sys.exit(main())
