"""Makes blind cases: `python -m benchmarks.blind.generate --help`."""

import argparse
import os
import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.blind import seal
from benchmarks.blind.chamber_case import chamber_case
from benchmarks.blind.frames import fix_times
from benchmarks.blind.plan import SUITES, Spec, cases
from benchmarks.blind.walking_case import walking_case
from benchmarks.blind.writing import truth, write_case, write_untouched


def names(seed: int, n: int) -> list[str]:
    """Names that say nothing, not even in what order the cases were made."""
    rng = np.random.default_rng([seed, 2])
    found: set[str] = set()
    while len(found) < n:
        found.add(f"case-{rng.integers(16**6):06x}")
    shuffled = sorted(found)
    return [shuffled[k] for k in rng.permutation(n)]


def _one(seed: int, index: int, spec: Spec, open_: Path, kept: Path) -> dict[str, Any]:
    case = walking_case(seed, index, spec) if spec.suite == "walking" else chamber_case(seed, index, spec)
    write_case(open_, case)
    write_untouched(kept, case)
    return {**truth(case), "handed_out": seal.digests(open_), "kept_back": seal.digests(kept)}


def generate(seed: int, suite: str, n: int, out: Path, sealed: Path, jobs: int) -> str:
    """Writes `out`/<case>/recording and `sealed`; returns the seal. Nothing stands in `out` before the seal exists."""
    for folder in (out, sealed):
        if folder.exists():
            raise SystemExit(f"{folder}: expected a folder that does not exist yet; remove it or name another one")
    specs = cases(seed, suite, n)
    called = names(seed, n)
    out.parent.mkdir(parents=True, exist_ok=True)
    sealed.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent) as a, tempfile.TemporaryDirectory(dir=sealed.parent) as b:
        open_, kept = Path(a) / "cases", Path(b) / "sealed"
        open_.mkdir()
        kept.mkdir()
        # A process a job, and no threads below it: they would only wait for each other.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
            waiting = [
                pool.submit(_one, seed, k, spec, open_ / name, kept / name)
                for k, (spec, name) in enumerate(zip(specs, called, strict=True))
            ]
            made = {}
            for k, (name, future) in enumerate(zip(called, waiting, strict=True)):
                made[name] = future.result()
                print(f"\r{k + 1} of {n} cases", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
        about = {"seed": seed, "suite": suite, "cases": n}
        printed = seal.close(kept, made, about)
        print(printed, flush=True)
        fix_times(open_)
        shutil.move(kept, sealed)
        shutil.move(open_, out)
    return printed


def main() -> None:
    ask = argparse.ArgumentParser(prog="python -m benchmarks.blind.generate", description=__doc__)
    ask.add_argument("--cases", type=int, required=True, help="how many")
    ask.add_argument("--suite", choices=SUITES, default="chamber")
    ask.add_argument("--seed", type=int, required=True, help="from outside; whoever knows it knows the cases")
    ask.add_argument("--out", type=Path, required=True, help="folder for what the tool is given")
    ask.add_argument("--sealed", type=Path, required=True, help="folder for the truth; keep it from the tool")
    ask.add_argument("--jobs", type=int, default=1)
    said = ask.parse_args()
    generate(said.seed, said.suite, said.cases, said.out, said.sealed, said.jobs)


if __name__ == "__main__":
    main()
