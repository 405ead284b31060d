"""Blind benchmark of the diagnosis: generate cases with concealed effects, run a tool on them, score its answers.

Its verbs are make, run and score; `insole prove` runs all three.

Takes a minute a case, and needs a verb.
"""

import argparse
import json
import sys
from pathlib import Path

from . import seal
from .generate import generate
from .plan import SUITES
from .run import run
from .score import markdown, score
from .untouched import imported

REFUSED, INTERRUPTED = 4, 130  # exit status
_SCHEDULER = "address of a Dask scheduler, whose workers see the same files; without it, one case after the other"


def _parser() -> argparse.ArgumentParser:
    ask = argparse.ArgumentParser(prog=f"python -m {__package__}", description=__doc__)
    verbs = ask.add_subparsers(dest="verb", required=True)
    make = verbs.add_parser("make", help="write a set of cases and its sealed truth; prints the seal")
    make.add_argument("--suite", choices=SUITES, default="all")
    make.add_argument("--seed", type=int, required=True, help="whoever knows it knows the cases")
    make.add_argument("--cases", type=int, required=True, help="how many")
    make.add_argument("--out", type=Path, required=True, help="folder for what the tool is given")
    make.add_argument("--sealed", type=Path, required=True, help="folder for the truth; keep it from the tool")
    make.add_argument("--scheduler", help=_SCHEDULER)
    tool = verbs.add_parser("run", help="run a tool on every case; goes on where it stopped")
    tool.add_argument("--cases", type=Path, required=True)
    tool.add_argument("--answers", type=Path, required=True)
    tool.add_argument("--scheduler", help=_SCHEDULER)
    tool.add_argument("--limit", type=float, default=300.0, help="seconds that a run may take")
    tool.add_argument("command", nargs="+", help="after --: insole diagnose {recording} {simulation} --out {out}")
    judge = verbs.add_parser("score", help="compare answers with the truth; prints the table")
    judge.add_argument("--sealed", type=Path, required=True)
    judge.add_argument("--answers", type=Path, required=True)
    judge.add_argument("--seal", required=True, help="what make printed")
    judge.add_argument("--predictor", help="module:function(model_json, recording, simulation) -> {foot: counts}")
    judge.add_argument("--compensator", help="module:function(model_json, recording) -> {foot: (t_s, fz_n)}")
    judge.add_argument("--json", type=Path, help="also write everything, case by case, into this file")
    return ask


def main() -> None:
    """Do what the command line asks for."""
    said = _parser().parse_args()
    if said.verb == "make":
        generate(said.seed, said.suite, said.cases, said.out, said.sealed, said.scheduler)
        return
    if said.verb == "run":
        run(said.command, said.cases, said.answers, said.limit, said.scheduler)
        return
    predict = imported(said.predictor) if said.predictor else None
    compensate = imported(said.compensator) if said.compensator else None
    try:
        found = score(said.sealed, said.answers, said.seal, predict, compensate)
    except seal.BrokenSealError as broken:
        raise SystemExit(str(broken)) from None
    if said.json:
        said.json.write_text(json.dumps(found, indent=1) + "\n")
    sys.stdout.write(markdown(found))


if __name__ == "__main__":
    try:
        main()
    except OSError as error:  # no room, no permission: the reason is enough
        print(f"{error.filename or 'the output'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(REFUSED)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
