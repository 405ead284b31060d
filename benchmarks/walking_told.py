"""What knowing the effects' names is worth on walks: beside `f_z … against the oracle` of the walking proof.

    python benchmarks/walking_told.py PROOF      # the folder that `insole prove --suite walking --out PROOF` has made

The oracle of that row reads an insole in which nothing was concealed, which no estimator can. This one is the tool told
the true structure: the same fit of the set that was really concealed, on the whole insole, and what its model leaves of
f_z, live, on the part of the walk that was kept back. What the tool leaves beyond that is the price of naming.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from blind.untouched import compare_force

from insole_daemon.diagnosis.audit import audit
from insole_daemon.diagnosis.compensation import of_walk
from insole_daemon.diagnosis.foot import camps, findings, modelling, walk
from insole_daemon.diagnosis.foot.deciding import Decided
from insole_daemon.diagnosis.foot.diagnosing import static_model
from insole_daemon.diagnosis.foot.evidence import Evidence
from insole_daemon.diagnosis.foot.hypothesis import Term
from insole_daemon.diagnosis.foot.naming import Naming, Search
from insole_daemon.diagnosis.foot.nulls import LEAST_PRICE
from insole_daemon.diagnosis.foot.part import part
from insole_daemon.recording.loading import load


def told(recording: Path, words: list[str], out: Path) -> str:
    """Write the model of the effects `words`, fitted to the walk, and say which foot it is."""
    loaded = load(recording)
    (foot,) = loaded.feet
    parts = [part(walk.read(loaded, foot, static_model(loaded, foot, None), audit(foot, recording.name, steps=True)))]
    evidence = Evidence(parts)
    search = Search(evidence, LEAST_PRICE)
    best = search.judged(frozenset(Term(word) for word in words))
    naming = Naming(search.judged(frozenset()), best, (), search.price)
    decided = Decided(best, dict.fromkeys(words, ()), dict.fromkeys(words, 1.0), {}, {}, (), unknown=False)
    explained = camps.fitted(evidence, naming, decided, np.zeros(1))
    effects = findings.named(explained)[1] + findings.drifts(explained)[1]
    provenance = {"recordings": [recording.name]}
    out.write_text(json.dumps(modelling.document(explained.evidence, explained.recalibration, effects, provenance)))
    return foot.layout.foot


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("proof", type=Path)
    proof: Path = parser.parse_args().proof
    ratios: dict[str, list[float]] = {}
    print("| case | concealed | the tool | told the names | |\n|---|---|---|---|---|")
    for case in json.loads((proof / "score.json").read_text())["cases"]:
        if case["kind"] not in ("single", "together", "null") or "model" not in (case.get("force") or {}):
            continue
        name, words = case["case"], case["wanted"] or []
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder, "model.json")
            foot = told(proof / "cases" / name / "recording", words, model)
            with_names_n = compare_force(proof / "sealed" / name, foot, model, of_walk)["model"]
        tool_n = case["force"]["model"]
        ratios.setdefault(case["kind"], []).append(tool_n / with_names_n)
        said = f"{tool_n:.1f} N | {with_names_n:.1f} N | {tool_n / with_names_n:.2f} ×"
        print(f"| {case['kind']} {name} | {' '.join(words)} | {said} |", flush=True)
    for kind, found in ratios.items():
        print(f"\n{kind}: median of {len(found)} {np.median(found):.2f} ×, largest {max(found):.2f} ×")


if __name__ == "__main__":
    main()
