"""Ablation study of the diagnosis: scores of the blind benchmark with one part of the method removed at a time.

    python -m benchmarks.diagnosis.ablations --seed N --cases 24 --out OUT
    python -m benchmarks.diagnosis.ablations --seed N --cases 120 --kinds triple --only whole greedy --out OUT

Generator and scorer are the unchanged programs of the blind benchmark (`benchmarks/diagnosis/blind`): the seal is
printed first, and every run is logged. Only the diagnosis is patched, in this program and nowhere in the package:

- greedy: forward selection without a beam; no term of a set is removed or exchanged again;
- no groups: places are the insole, a board or one triangle, not other sets of triangles;
- exact laws: laws have no misfit;
- exact calibration: gains, baselines and curves of the calibration have no error;
- no refinement: parameters are those of the coarse grid.

`--kinds` restricts the cases to those that show a part's use: greedy selection fails on triples, where the best single
effect may be none of the three. Only this program reads the kind of a case, never the diagnosis.

Takes about an hour, and needs --seed and --out.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np

from insole_daemon.cli import app
from insole_daemon.diagnosis import searching
from insole_daemon.diagnosis.model import nuisance, refine, wrench_nuisance
from insole_daemon.diagnosis.select.search import SubsetSearch
from insole_daemon.diagnosis.terms import TERMS

EXACT = 1e-9  # of a prior's standard deviation


def replace_part(owner: Any, name: str, replacement: Any) -> None:
    """Replaces a part; AttributeError where the pipeline has no such part any more."""
    getattr(owner, name)
    setattr(owner, name, replacement)


def greedy() -> None:
    replace_part(SubsetSearch, "_improve", lambda self, start: start)
    replace_part(sys.modules[SubsetSearch.__module__], "BEAM", 1)


def no_groups() -> None:
    replace_part(searching, "with_groups", lambda whole, best: whole)


def exact_laws() -> None:
    for term in TERMS:
        object.__setattr__(term, "misfit", 0.0 * term.misfit)


def exact_calibration() -> None:
    for module in (nuisance, wrench_nuisance):
        for name in ("GAIN_STD", "BASELINE_STD_COUNT", "CURVE_STD_COUNT"):
            replace_part(module, name, EXACT)
    replace_part(wrench_nuisance, "CURVE_STD_AT_REST_COUNT", EXACT)


def no_refinement() -> None:
    replace_part(refine, "ROUNDS", 0)


_BLIND = "benchmarks.diagnosis.blind"
ABLATIONS: dict[str, Callable[[], None]] = {
    "whole": lambda: None,
    "greedy": greedy,
    "no groups": no_groups,
    "exact laws": exact_laws,
    "exact calibration": exact_calibration,
    "no refinement": no_refinement,
}


def run(*command: str) -> str:
    done = subprocess.run([sys.executable, "-m", *command], stdout=subprocess.PIPE, text=True, check=True)
    return done.stdout.strip()


def score(out: Path, name: str, seal: str) -> dict[str, Any]:
    """The blind benchmark's tables with one part taken out."""
    answers = out / name.replace(" ", "-")
    tool = [sys.executable, "-m", "benchmarks.diagnosis.ablations", "--as", name, "{recording}", "{simulation}"]
    run(_BLIND, "run", "--cases", f"{out}/cases", "--answers", str(answers), "--", *tool, "--out", "{out}")
    run(_BLIND, "score", "--sealed", f"{out}/sealed", "--answers", str(answers), "--seal", seal,
        "--json", f"{answers}.json")  # fmt: skip
    scores: dict[str, Any] = json.loads(Path(f"{answers}.json").read_text())
    return scores


def row(scores: dict[str, Any]) -> list[str]:
    answered = [case for case in scores["cases"] if case["answered"]]
    right = {"single": "points", "pair": "exact", "triple": "exact", "null": "false_alarm",
             "unknown": "points", "undecidable": "points"}  # fmt: skip
    shown = []
    for kind, key in right.items():
        values = [float(case[key]) for case in answered if case["kind"] == kind]
        shown.append(f"{sum(values):g} of {len(values)}" if values else "–")
    named = [(r["wanted"], {words[0] for words in r["named"]}) for r in answered]
    shown.append(str(sum(len(words - set(wanted) - {"unknown"}) for wanted, words in named)))
    cpu = [r["run"]["cpu_seconds"] for r in answered]
    return [*shown, f"{np.median(cpu):.0f}"]


def leave_out(out: Path, kinds: Collection[str]) -> None:
    """Puts cases of other kinds aside."""
    truth = json.loads((out / "sealed/truth.json").read_text())["cases"]
    (out / "aside").mkdir()
    for name, case in truth.items():
        if case["kind"] not in kinds:
            (out / "cases" / name).rename(out / "aside" / name)


def main() -> None:
    ask = argparse.ArgumentParser(prog="python -m benchmarks.diagnosis.ablations", description=__doc__)
    ask.add_argument("--seed", type=int, required=True, help="from outside, a fresh one")
    ask.add_argument("--cases", type=int, default=24)
    ask.add_argument("--kinds", nargs="+", metavar="KIND", help="of cases that are answered; all unless said")
    ask.add_argument("--only", nargs="+", choices=ABLATIONS, default=list(ABLATIONS), metavar="PART")
    ask.add_argument("--out", type=Path, required=True)
    options = ask.parse_args()
    options.out.mkdir(parents=True)
    seal = run(
        _BLIND, "make", "--seed", str(options.seed), "--suite", "chamber", "--cases", str(options.cases),
        "--out", f"{options.out}/cases", "--sealed", f"{options.out}/sealed",
    )  # fmt: skip
    print(f"seal {seal}, seed {options.seed}, {options.cases} cases\n", flush=True)
    if options.kinds:
        leave_out(options.out, options.kinds)
    head = ["what answers", "single", "pair exact", "triple exact", "nulls alarmed", "outside: unknown",
            "undecidable: said so", "names of what is not there", "CPU, median s"]  # fmt: skip
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head), flush=True)
    for name in options.only:
        print("| " + " | ".join([name, *row(score(options.out, name, seal))]) + " |", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--as"]:
        ABLATIONS[sys.argv[2]]()
        app(["diagnose", *sys.argv[3:]])
    else:
        main()
