"""What holds of every diagnosis, whatever is concealed: the same names however it is recorded, no static word for a
memory that the calibration contains, a nuisance beyond its prior by its name, figures that the files themselves give,
and no finding on readings that another finding takes away."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import insole_daemon
from insole_daemon.cli import app
from insole_daemon.diagnosis import prediction
from insole_daemon.diagnosis.outcome import LEAST_EXPLAINED, MOST_AFTER
from insole_daemon.physics import calibration as calibrations

from . import chamber
from .chamber import LAYOUT, Array, relaxing
from .foot import shoe
from .variations import MASKED, VARIATIONS, varied, with_reference, with_taxels

SECONDS = 60.0  # of a chamber
BOARD = 7
ON_BOARD = np.repeat(LAYOUT.identities[:, 0] == BOARD, 12)
MEMORY = relaxing(0.3, 0.8)
STATIC = {"gain", "baseline", "stiffening", "preload", "bit_shift"}
NEVER_ANSWERING = {"dead_taxels", "open_triangle"}  # of a whole board that says one number for ever
TIMING = {"clock", "delay"}  # which of the two cannot be told from a clock alone


def cases(kinds: Iterable[str], names: Iterable[Any], defects: Mapping[tuple[Any, ...], str]) -> list[Any]:
    """Parameters of a test for every kind and name; `defects`: the ones the engine fails, with what it does."""
    marked = []
    for kind in kinds:
        for name in names:
            key = (kind, *name) if isinstance(name, tuple) else (kind, name)
            marks = [pytest.mark.xfail(strict=True, reason=defects[key])] if key in defects else []
            marked.append(pytest.param(*key, marks=marks, id=" ".join(f"{part}" for part in key)))
    return marked


def diagnose(folder: Path, out: Path) -> dict[str, Any]:
    """What diagnosis.json says."""
    done = CliRunner().invoke(app, ["diagnose", str(folder), "--out", str(out)])
    assert done.exit_code in (0, 1, 3), (done.output, done.exception)
    return json.loads((out / "diagnosis.json").read_text())


def words(found: dict[str, Any]) -> set[str]:
    return {each["effect"] for each in found["findings"]}


def solid(p: Array) -> Array:
    return 0.8 * p + 0.2 * shoe.late(p, 0.4)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A chamber and a walk in which board 7 is viscoelastic, and both with nothing."""
    folder = tmp_path_factory.mktemp("recordings")
    return {
        "chamber": chamber.write(folder / "chamber", MEMORY, ON_BOARD, seconds=SECONDS),
        "walk": shoe.write(folder / "walk", solid, ON_BOARD),
        "null chamber": chamber.write(folder / "null-chamber", seconds=SECONDS),
        "null walk": shoe.write(folder / "null-walk"),
    }


@pytest.mark.parametrize(
    ("kind", "variation"),
    cases(["chamber", "walk"], VARIATIONS, {}),
)
def test_names_do_not_depend_on_how_the_trial_is_recorded(recordings, tmp_path, kind, variation):
    found = diagnose(varied(recordings[kind], tmp_path / "varied", VARIATIONS[variation]), tmp_path / "out")
    assert words(found) == {"viscoelasticity"}
    (finding,) = found["findings"]
    assert finding["where"]["scope"] == "board"


@pytest.mark.parametrize(("kind", "variation"), cases(["null chamber", "null walk"], VARIATIONS, {}))
def test_a_null_has_no_finding_however_it_is_recorded(recordings, tmp_path, kind, variation):
    found = diagnose(varied(recordings[kind], tmp_path / "varied", VARIATIONS[variation]), tmp_path / "out")
    assert (words(found), found["verdict"]) == (set(), "no mismatch")


# ---- shadow: three protocols of a static calibration, on a sensor with memory


def through_the_middle(read: Array, pressure: Array) -> Array:
    """(4,) coefficients of the cubic through all readings."""
    return np.polynomial.polynomial.polyfit(read, pressure, 3)


def of_holds(read: Array, pressure: Array) -> Array:
    """… through those while the pressure has not changed for 0.3 s."""
    still = np.abs(np.gradient(pressure)) < 30.0
    kept = still & (np.convolve(still, np.ones(15), mode="same") > 14)
    return through_the_middle(read[kept], pressure[kept])


def of_loading(read: Array, pressure: Array) -> Array:
    """… through those while the pressure rises."""
    rises = np.gradient(pressure) > 100.0
    return through_the_middle(read[rises], pressure[rises])


@pytest.mark.parametrize("protocol", [through_the_middle, of_holds, of_loading])
def test_a_memory_in_the_calibration_causes_no_static_finding(tmp_path, protocol):
    folder = chamber.write(tmp_path / "bag", relaxing(0.3, 2.0), seconds=SECONDS)
    calibrate(folder, protocol)
    found = diagnose(folder, tmp_path / "out")
    assert words(found) & STATIC == set()
    assert words(found) & {"viscoelasticity", "creep"}


def calibrate(folder: Path, protocol: Callable[[Array, Array], Array]) -> None:
    """Give the recording the curves that `protocol` fits to its own readings."""
    foot = insole_daemon.load(folder).feet[0]
    pressure = np.interp(foot.t_ns * 1e-9, foot.reference.time_s, foot.reference["pressure_pa"])
    pressure = np.convolve(pressure, np.ones(5) / 5, mode="same")
    rows = foot.layout.rows

    def refit(taxel: dict[str, Any]) -> None:
        read = foot.counts[:, rows[taxel["board"], taxel["triangle"]], taxel["taxel"]].astype(float)
        fitted = protocol(taxel["baseline_count"] - read, pressure)
        taxel["coefficients_pa"] = fitted.tolist()

    with_taxels(folder, refit)


# ---- nuisances: 3, 10 and 30 standard deviations of what each is believed to be before


def gained(size: float) -> Callable[[Path], None]:
    """The sensor answers by a share more than its calibration says."""

    def change(taxel: dict[str, Any]) -> None:
        taxel["coefficients_pa"] = [c * (1.0 + size) ** -k for k, c in enumerate(taxel["coefficients_pa"])]

    return lambda folder: with_taxels(folder, change)


def based(size: float) -> Callable[[Path], None]:
    """The calibration has other baselines, counts."""

    def change(taxel: dict[str, Any]) -> None:
        taxel["baseline_count"] += size

    return lambda folder: with_taxels(folder, change)


def offset(size: float) -> Callable[[Path], None]:
    """The reference is stamped later, s."""

    def change(columns: dict[str, Array]) -> None:
        columns["time_s"] += size

    return lambda folder: with_reference(folder, change)


def rated(size: float) -> Callable[[Path], None]:
    """The reference's clock runs by a share faster."""

    def change(columns: dict[str, Array]) -> None:
        columns["time_s"] += size * (columns["time_s"] - columns["time_s"][0])

    return lambda folder: with_reference(folder, change)


def zeroed(size: float) -> Callable[[Path], None]:
    """The reference reads more, Pa or N."""

    def change(columns: dict[str, Array]) -> None:
        for name in columns.keys() & {"pressure_pa", "fz_n"}:
            columns[name] += size

    return lambda folder: with_reference(folder, change)


# By name: how it is made, its standard deviation in a chamber and on a walk, and the names it may have. Of straight
# curves a baseline is a preload, and of a uniform load the zero of the reference is both. A declared clock is good to
# 1 ms and 20 ppm (formats.md).
NUISANCES: dict[str, tuple[Callable[[float], Callable[[Path], None]], tuple[float, float], set[str]]] = {
    "gain": (gained, (0.003, 0.005), {"gain"}),
    "baseline": (based, (0.05, 0.02), {"baseline", "preload"}),
    "clock offset": (offset, (0.001, 0.001), TIMING),
    "clock rate": (rated, (20e-6, 20e-6), {"clock"}),
    "zero of the reference": (zeroed, (100.0, 0.5), {"reference_fault", "baseline", "preload"}),
}
WITHIN_FORMATS = ("clock rate", 3.0)  # 60 ppm: up to 100 ppm is no finding


SMALL = "it moves readings by less than 0.15 of their noise, LEAST_SIZE, and is silent"
SMALL_ON_WALKS = "it explains less than LEAST_GAIN and the price of the search, and is silent"


@pytest.mark.parametrize(
    ("kind", "nuisance", "sigmas"),
    cases(
        ["null chamber", "null walk"],
        [(nuisance, sigmas) for nuisance in NUISANCES for sigmas in (3.0, 10.0, 30.0)],
        {
            ("null chamber", "baseline", 3.0): SMALL,
            ("null chamber", "clock offset", 3.0): SMALL,
            ("null chamber", "clock offset", 10.0): SMALL,
            ("null chamber", "zero of the reference", 3.0): SMALL,
            ("null chamber", "zero of the reference", 10.0): SMALL,
            ("null walk", "gain", 3.0): SMALL_ON_WALKS,
            ("null walk", "baseline", 3.0): SMALL_ON_WALKS,
            ("null walk", "baseline", 10.0): SMALL_ON_WALKS,
            ("null walk", "zero of the reference", 3.0): SMALL_ON_WALKS,
        },
    ),
)
def test_a_nuisance_beyond_its_prior_is_reported_by_its_name(recordings, tmp_path, kind, nuisance, sigmas):
    change, std, names = NUISANCES[nuisance]
    size = sigmas * std[kind == "null walk"]
    found = diagnose(varied(recordings[kind], tmp_path / "off", change(size)), tmp_path / "out")
    assert words(found) <= names
    assert words(found) or (nuisance, sigmas) == WITHIN_FORMATS


# ---- coherence: the figures, from the files alone


@pytest.fixture(scope="module")
def both(recordings, tmp_path_factory) -> Path:
    """A chamber with a memory of board 7 and a gain of board 5, diagnosed."""
    folder = tmp_path_factory.mktemp("both")

    def weaker(t_s: Array, counts: Array) -> None:
        own = np.repeat(LAYOUT.identities[:, 0] == 5, 12)
        counts[:, own] = 240.5 - 0.9 * (240.5 - counts[:, own])

    chamber.write(folder / "bag", MEMORY, ON_BOARD, touch=weaker, seconds=SECONDS)
    diagnose(folder / "bag", folder / "out")
    return folder


def rms(folder: Path, model: Path) -> float:
    """By which the readings of usable taxels are off what `model` expects under the reference, counts."""
    recording = insole_daemon.load(folder)
    (foot,) = recording.feet
    expected = prediction.counts(model, recording)[foot.foot]
    usable = foot.calibration.usable & calibrations.load(model, foot.layout).usable
    t_s = foot.t_ns * 1e-9 - foot.reference.time_s[0]
    inside = (t_s > 1.0) & (t_s < t_s[-1] - 1.0)
    return float(np.sqrt(np.mean((foot.counts - expected)[inside][:, usable] ** 2)))


def test_before_and_after_are_the_errors_of_the_written_files(both):
    heldout = json.loads((both / "out" / "diagnosis.json").read_text())["heldout"]
    assert rms(both / "bag", both / "bag" / "calibration.json") == pytest.approx(heldout["before"], rel=0.03)
    assert rms(both / "bag", both / "out" / "model.json") == pytest.approx(heldout["after"], rel=0.03)


def test_shares_are_the_gains_of_findings_in_their_order(both, tmp_path):
    found = json.loads((both / "out" / "diagnosis.json").read_text())
    model = json.loads((both / "out" / "model.json").read_text())
    own = json.loads((both / "bag" / "calibration.json").read_text())
    assert [each["effect"] for each in found["findings"]] == sorted(
        words(found), key=lambda word: -next(f["explains"] for f in found["findings"] if f["effect"] == word)
    )
    squares = [rms(both / "bag", both / "bag" / "calibration.json") ** 2]
    for n in range(1, len(found["findings"]) + 1):
        entered = {each["effect"] for each in found["findings"][:n]}
        part = {**own, "effects": [each for each in model["effects"] if each["effect"] in entered]}
        (tmp_path / "part.json").write_text(json.dumps(part))
        squares.append(rms(both / "bag", tmp_path / "part.json") ** 2)
    whole = found["heldout"]["before"] ** 2 - found["heldout"]["after"] ** 2
    gained = -np.diff(squares) / whole
    assert [each["explains"] for each in found["findings"]] == pytest.approx(gained.tolist(), abs=0.03)


def verdict_of(found: dict[str, Any]) -> str:
    """By formats.md, of what is decidable."""
    before, after, floor = (found["heldout"][name] for name in ("before", "after", "floor"))
    if not found["findings"] and before**2 <= 1.25 * floor**2:
        return "no mismatch"
    if found["findings"] and after <= MOST_AFTER * floor:
        return "explained"
    whole = before**2 - floor**2
    return "partly explained" if before**2 - after**2 >= LEAST_EXPLAINED * whole else "unexplained"


def test_shares_sum_to_one_and_the_verdict_follows_from_the_numbers(both, recordings, tmp_path):
    every = [json.loads((both / "out" / "diagnosis.json").read_text())]
    every += [diagnose(recordings[kind], tmp_path / kind) for kind in recordings]
    for found in every:
        total = sum(each["explains"] for each in found["findings"]) + found["alignment_share"]
        assert total == pytest.approx(1.0, abs=2e-4)
        assert min([0.0, *(each["explains"] for each in found["findings"])]) >= 0.0
        assert found["verdict"] == verdict_of(found)


# ---- evidence: nothing rests on readings that another finding takes away


def test_a_dead_board_has_no_other_finding(tmp_path):
    def die(t_s: Array, counts: Array) -> None:
        counts[:, ON_BOARD] = 240.0

    found = diagnose(chamber.write(tmp_path / "bag", touch=die, seconds=SECONDS), tmp_path / "out")
    assert len(found["findings"]) == 1
    assert words(found) <= NEVER_ANSWERING


def test_a_burst_of_noise_causes_no_further_finding(tmp_path):
    rng = np.random.default_rng(4)

    def burst(t_s: Array, counts: Array) -> None:
        there = (t_s > 20.0) & (t_s < 30.0)
        counts[np.ix_(there, ON_BOARD)] += rng.normal(0.0, 12.0, (int(there.sum()), int(ON_BOARD.sum())))

    found = diagnose(chamber.write(tmp_path / "bag", touch=burst, seconds=SECONDS), tmp_path / "out")
    assert words(found) == {"noise_burst"}


def test_a_memory_is_detected_beside_a_dead_board_and_not_placed_on_it(tmp_path):
    dead = np.repeat(LAYOUT.identities[:, 0] == MASKED, 12)

    def die(t_s: Array, counts: Array) -> None:
        counts[:, dead] = 240.0

    found = diagnose(chamber.write(tmp_path / "bag", MEMORY, ON_BOARD, touch=die, seconds=SECONDS), tmp_path / "out")
    assert len(found["findings"]) == 2
    assert words(found) <= {"viscoelasticity"} | NEVER_ANSWERING
    (memory,) = (each for each in found["findings"] if each["effect"] == "viscoelasticity")
    assert not is_on(memory, MASKED)


def is_on(finding: dict[str, Any], board: int) -> bool:
    where = finding["where"]
    return where["scope"] == "insole" or any(identity[0] == board for identity in where["ids"])
