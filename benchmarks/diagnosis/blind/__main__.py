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
from .untouched import import_function

REFUSED, INTERRUPTED = 4, 130  # exit status
_SCHEDULER = "address of a Dask scheduler, whose workers see the same files; without it, one case after the other"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=f"python -m {__package__}", description=__doc__)
    programs = parser.add_subparsers(dest="verb", required=True)
    make_parser = programs.add_parser("make", help="write a set of cases and its sealed truth; prints the seal")
    make_parser.add_argument("--suite", choices=SUITES, default="all")
    make_parser.add_argument(
        "--seed", type=int, required=True, help="seed of the random numbers; the same seed makes the same cases"
    )
    make_parser.add_argument("--cases", type=int, required=True, help="how many")
    make_parser.add_argument("--out", type=Path, required=True, help="folder for what the tool is given")
    make_parser.add_argument("--sealed", type=Path, required=True, help="folder for the truth; keep it from the tool")
    make_parser.add_argument("--scheduler", help=_SCHEDULER)
    run_parser = programs.add_parser("run", help="run a tool on every case; skips cases that have an answer")
    run_parser.add_argument("--cases", type=Path, required=True)
    run_parser.add_argument("--answers", type=Path, required=True)
    run_parser.add_argument("--scheduler", help=_SCHEDULER)
    run_parser.add_argument("--limit", type=float, default=300.0, help="seconds that a run may take")
    run_parser.add_argument("command", nargs="+", help="after --: insole diagnose {recording} {simulation} --out {out}")
    score_parser = programs.add_parser("score", help="compare answers with the truth; prints the table")
    score_parser.add_argument("--sealed", type=Path, required=True)
    score_parser.add_argument("--answers", type=Path, required=True)
    score_parser.add_argument("--seal", required=True, help="what make printed")
    score_parser.add_argument(
        "--predictor", help="module:function(model_json, recording, simulation) -> {foot: counts}"
    )
    score_parser.add_argument("--compensator", help="module:function(model_json, recording) -> {foot: (t_s, fz_n)}")
    score_parser.add_argument("--json", type=Path, help="also write everything, case by case, into this file")
    return parser


def main() -> None:
    """Run the program that the command line names."""
    arguments = _parser().parse_args()
    if arguments.verb == "make":
        generate(arguments.seed, arguments.suite, arguments.cases, arguments.out, arguments.sealed, arguments.scheduler)
        return
    if arguments.verb == "run":
        run(arguments.command, arguments.cases, arguments.answers, arguments.limit, arguments.scheduler)
        return
    predict = import_function(arguments.predictor) if arguments.predictor else None
    compensate = import_function(arguments.compensator) if arguments.compensator else None
    try:
        scores = score(arguments.sealed, arguments.answers, arguments.seal, predict, compensate)
    except seal.BrokenSealError as error:
        raise SystemExit(str(error)) from None
    if arguments.json:
        arguments.json.write_text(json.dumps(scores, indent=1) + "\n")
    sys.stdout.write(markdown(scores))


if __name__ == "__main__":
    try:
        main()
    except OSError as error:  # for a full disk or a missing permission, the reason is enough
        print(f"{error.filename or 'the output'}: {error.strerror or error}", file=sys.stderr)
        sys.exit(REFUSED)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
