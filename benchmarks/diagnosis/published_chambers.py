"""Results of `insole diagnose` on the published chamber recordings of Belli et al. 2023, where nothing was concealed.

    python -m benchmarks.diagnosis.published_chambers [--folder ../shared/data/belli2023]

Each file is imported and diagnosed by itself, without a calibration: the curves that fit it best replace one. Errors
are those of held-out blocks; the curves of the static model are the best polynomials and splines of the load for every
taxel. Prints for each file: verdict, errors, findings with their places, thresholds of boards that switch with the
load, and run time; the noise at rest by the diagnosis, and from conversions that differ from the last ones; then the
spread of thresholds across files, and, of the files in which the findings lower the error of static curves by a fifth,
the number with a memory among them.

Takes about 10 minutes.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

import insole_daemon
from benchmarks.published_data.belli2023 import FOLDER
from insole_daemon.diagnosis.floor import noise_of_readings
from insole_daemon.diagnosis.observations.wrench import WrenchObservation
from insole_daemon.diagnosis.pipeline import diagnose
from insole_daemon.recording import counts as counts_file
from insole_daemon.recording.import_matlab import import_matlab

MEMORY = {"viscoelasticity", "creep", "hysteresis", "lag"}
CLEAR = 0.8  # times the error of static curves
AT_REST, LEAST_AT_REST = 0.05, 50  # of the range of the load; readings of a triangle


def noise_at_rest(folder: Path, foot: str, seen: WrenchObservation) -> tuple[float, float]:
    """Noise of the median taxel at rest, counts: by the diagnosis, and from conversions that differ from the last."""
    table = counts_file.read(folder / "counts.npz", {foot: len(seen.layout)})[foot]
    table_s = (table.t_ns - table.t_ns[0]) * 1e-9
    threshold = seen.load_course.min() + AT_REST * np.ptp(seen.load_course)
    by_diagnosis, by_differences = [], []
    for row, (readings, usable) in enumerate(zip(seen.readings, seen.usable, strict=True)):
        new = 1 + np.flatnonzero(np.any(np.diff(table.counts[:, row].astype(int), axis=0) != 0, axis=1))
        is_rest = np.interp(table_s[new], seen.t_s, seen.load_course) < threshold
        difference = np.diff(table.counts[new, row].astype(float), axis=0)[is_rest[1:] & is_rest[:-1]][:, usable]
        resting = readings.counts[np.interp(readings.t_s, seen.t_s, seen.load_course) < threshold][:, usable]
        if min(len(difference), len(resting)) > LEAST_AT_REST and usable.any():
            by_diagnosis.append(noise_of_readings(resting))
            by_differences.append(np.sqrt(np.mean(difference**2, axis=0) / 2.0))
    return float(np.median(np.concatenate(by_diagnosis))), float(np.median(np.concatenate(by_differences)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    folder = parser.parse_args().folder
    thresholds: dict[tuple[object, ...], list[tuple[float, float]]] = {}
    clear = named = 0
    for path in sorted(folder.glob("*_insole/*.mat")):
        with tempfile.TemporaryDirectory() as into:
            foot = path.parent.name.split("_")[0]
            written = import_matlab(path, Path(into) / path.stem, foot, None)
            recording = insole_daemon.load(written)
            began = time.monotonic()
            diagnosis = diagnose([recording], None, lambda text: None)
            by_diagnosis, by_differences = noise_at_rest(written, foot, diagnosis.results[0].seen)
        errors = {name: diagnosis.heldout[name] for name in ("before", "after", "floor")}
        print(f"{path.stem}: {diagnosis.verdict}, {errors}, {time.monotonic() - began:.0f} s")
        print(f"  noise at rest {by_diagnosis:.2f} counts, from new conversions {by_differences:.2f}")
        for each in diagnosis.findings:
            print(f"  {each.effect} at {each.where.scope} {each.where.ids if len(each.where.ids) < 6 else '…'}")
            if each.effect == "snap":
                up, down = (float(each.parameters[name].value) for name in ("up_pa", "down_pa"))
                print(f"    up {up / 1e3:.1f} kPa, down {down / 1e3:.1f} kPa")
                thresholds.setdefault((foot, *each.where.ids), []).append((up, down))
        if diagnosis.heldout["after"] < CLEAR * diagnosis.heldout["before"]:
            clear += 1
            named += bool(MEMORY & {each.effect for each in diagnosis.findings})
    for where, every in thresholds.items():
        for k, name in enumerate(("up", "down")):
            values = [each[k] for each in every]
            middle = sum(values) / len(values)
            apart = max(abs(value / middle - 1.0) for value in values)
            print(
                f"{where}: {name} in {len(values)} files, at most {apart:.0%} off their mean of {middle / 1e3:.1f} kPa"
            )
    print(f"memory named in {named} of {clear} files that became a fifth better")


if __name__ == "__main__":
    main()
