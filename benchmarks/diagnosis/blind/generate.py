"""Makes a set of cases: the folders that the tool gets, and the sealed truth."""

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
from .truth import truth
from .workers import dask_executor
from .writing import write_case, write_kept_back

SET = "set.json"  # suite, seed and seal, beside the cases


def draw_names(seed: int, n: int) -> list[str]:
    """Draw `n` names that show nothing about the cases, not even their order."""
    rng = np.random.default_rng([seed, 2])
    drawn: set[str] = set()
    while len(drawn) < n:
        drawn.add(f"case-{rng.integers(16**6):06x}")
    in_order = sorted(drawn)
    return [in_order[k] for k in rng.permutation(n)]


def _make_case(seed: int, index: int, spec: Spec, handed_out: Path, kept_back: Path) -> dict[str, Any]:
    """Draw and write one case; return its truth with the digests of its files."""
    case = draw_case(seed, index, spec)
    write_case(handed_out, case)
    write_kept_back(kept_back, case)
    return {**truth(case), "handed_out": seal.digests(handed_out), "kept_back": seal.digests(kept_back)}


def generate(seed: int, suite: str, n: int, out: Path, sealed: Path, scheduler: str | None = None) -> str:
    """Write `out`/<case>/recording and `sealed`; return the seal. `out` does not exist before the seal is printed.

    Cases are made one after the other, or on the workers of the Dask scheduler.
    """
    out, sealed = out.resolve(), sealed.resolve()
    for folder in (out, sealed):
        if folder.exists():
            raise SystemExit(f"{folder}: expected a folder that does not exist yet; remove it or name another one")
    specs = cases(seed, suite, n)
    names = draw_names(seed, n)
    out.parent.mkdir(parents=True, exist_ok=True)
    sealed.parent.mkdir(parents=True, exist_ok=True)
    with (
        tempfile.TemporaryDirectory(dir=out.parent) as cases_parent,
        tempfile.TemporaryDirectory(dir=sealed.parent) as sealed_parent,
    ):
        handed_out, kept_back = Path(cases_parent) / "cases", Path(sealed_parent) / "sealed"
        handed_out.mkdir()
        kept_back.mkdir()
        # One process without threads, as on Dask's workers: threads of the linear algebra would wait for each other.
        os.environ["OPENBLAS_NUM_THREADS"] = "1"
        workers = ProcessPoolExecutor(1, get_context("spawn")) if scheduler is None else dask_executor(scheduler)
        with workers as pool:
            futures = [
                pool.submit(_make_case, seed, k, spec, handed_out / name, kept_back / name)
                for k, (spec, name) in enumerate(zip(specs, names, strict=True))
            ]
            truths = {}
            for k, (name, future) in enumerate(zip(names, futures, strict=True)):
                truths[name] = future.result()
                print(f"\r{k + 1} of {n} cases", end="", file=sys.stderr, flush=True)
            print(file=sys.stderr)
        description = {"seed": seed, "suite": suite, "cases": n}
        seal_sha256 = seal.close(kept_back, truths, description)
        (handed_out / SET).write_text(json.dumps({**description, "seal": seal_sha256}) + "\n")
        print(seal_sha256, flush=True)
        fix_times(handed_out)
        shutil.move(kept_back, sealed)
        shutil.move(handed_out, out)
    return seal_sha256
