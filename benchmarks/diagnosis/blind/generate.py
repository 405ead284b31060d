"""Makes a set of cases: what the tool is given, and the sealed truth."""

import json
import os
import shutil
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from . import seal
from .boards import fix_times
from .case import draw_case
from .plan import Spec, cases
from .workers import dask_executor
from .writing import truth, write_case, write_kept_back

SET = "set.json"  # suite, seed and seal, beside the cases


def names(seed: int, n: int) -> list[str]:
    """Names that say nothing, not even in what order the cases were made."""
    rng = np.random.default_rng([seed, 2])
    found: set[str] = set()
    while len(found) < n:
        found.add(f"case-{rng.integers(16**6):06x}")
    shuffled = sorted(found)
    return [shuffled[k] for k in rng.permutation(n)]


def _one(seed: int, index: int, spec: Spec, given: Path, kept: Path) -> dict[str, Any]:
    case = draw_case(seed, index, spec)
    write_case(given, case)
    write_kept_back(kept, case)
    return {**truth(case), "handed_out": seal.digests(given), "kept_back": seal.digests(kept)}


def generate(seed: int, suite: str, n: int, out: Path, sealed: Path, scheduler: str | None = None) -> str:
    """Writes `out`/<case>/recording and `sealed`; returns the seal. Nothing stands in `out` before the seal exists.

    Cases are made one after the other, or on the workers of the Dask scheduler.
    """
    out, sealed = out.resolve(), sealed.resolve()
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
        # A process of its own, and no threads below it: they would only wait for each other. So are Dask's workers.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        workers = ProcessPoolExecutor(1, get_context("spawn")) if scheduler is None else dask_executor(scheduler)
        with workers as pool:
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
        (open_ / SET).write_text(json.dumps({**about, "seal": printed}) + "\n")
        print(printed, flush=True)
        fix_times(open_)
        shutil.move(kept, sealed)
        shutil.move(open_, out)
    return printed
