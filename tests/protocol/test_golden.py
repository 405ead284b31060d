"""The golden logs through the real pipeline, against what the oracle says of them."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import logs
import numpy as np
import oracle
import pytest
import regenerate
from pipeline import GOLDEN, NAMES, Published, at_once, golden, live, log_of

from insole_daemon.bus import replay
from insole_daemon.skin.faults import FaultWatch
from insole_daemon.skin.layout import builtin, load
from insole_daemon.wire.messages import Pressure, Raw, Wrench

REL = 1e-6  # pressure and age travel as float32


@pytest.fixture(autouse=True)
def _no_faults_are_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """The golden logs say what frames mean by the protocol; what is found wrong with them is not part of it."""
    monkeypatch.setattr(FaultWatch, "screen", lambda *_: None)
    monkeypatch.setattr(FaultWatch, "update", lambda *_: [])


def bits(masks: list[int]) -> np.ndarray:
    return np.array(masks)[:, None] >> np.arange(12) & 1


def floats(values: list[Any]) -> np.ndarray:
    return np.array([np.nan if value is None else value for value in values], float)


def assert_cycle(cycle: tuple[Raw, Pressure, Wrench], expected: dict[str, Any], foot: str) -> None:
    raw, pressure, wrench = cycle
    assert raw.counts.tolist() == [list(bytes.fromhex(of)) for of in expected["counts"]]
    assert raw.status.tolist() == expected["status"]
    assert (raw.triangle_t_ns // 1000).tolist() == [t or 0 for t in expected["triangle_t_us"]]
    assert (raw.late, raw.repeated) == (expected["late"], expected["repeated"])
    for message in cycle:
        assert (message.foot, message.seq, message.n_triangles) == (foot, expected["seq"], 28)
        assert message.t_ns == expected["t_us"] * 1000
        assert message.repeated == expected["repeated"]
        assert np.flatnonzero(message.missing).tolist() == expected["missing"]
        np.testing.assert_array_equal(message.valid, bits(expected["valid"]))
        np.testing.assert_allclose(message.age_ms, floats(expected["age_ms"]), rtol=REL)
    expected_pa = 1e3 * np.array([floats(of) for of in expected["pressure_kpa"]])
    np.testing.assert_allclose(pressure.pressure_pa, expected_pa, rtol=REL)
    for name in ("f_z_n", "m_x_nm", "m_y_nm", "cop_x_m", "cop_y_m", "contact_area_m2", "valid_fraction"):
        value = getattr(wrench, name)
        if expected[name] is None:
            assert np.isnan(floats([value])), name
        else:
            assert value == pytest.approx(expected[name], rel=REL), name
    known = 0 < wrench.valid_fraction < 1  # the calibration carries no uncertainty: only what is missing counts
    assert (np.isnan(floats([wrench.f_z_std_n, wrench.m_x_std_nm, wrench.m_y_std_nm])) == (not known)).all()


def assert_published(published: Published, name: str) -> None:
    file = golden(name)
    refused = dataclasses.asdict(published.skin.streams.refused)
    for by_address in ("unconfigured_board", "overflow"):
        refused[by_address] = {str(address): n for address, n in refused[by_address].items()}
    assert refused == file["refused"]
    for assembler, cycles, expected in zip(published.skin.assemblers, published.cycles, file["feet"], strict=True):
        for cycle, of in zip(cycles, expected["cycles"], strict=False):
            assert_cycle(cycle, of, expected["foot"])
        assert len(cycles) == len(expected["cycles"])
        counted = assembler.superseded, int(assembler.missed.sum()), assembler.skipped
        assert counted == tuple(expected[key] for key in ("superseded_halves", "missed_halves", "skipped"))


@pytest.mark.parametrize("frames_at_a_time", [1, 17, 4096])
@pytest.mark.parametrize("name", NAMES)
def test_replay(name: str, frames_at_a_time: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replay, "BATCH_FRAMES", frames_at_a_time)
    assert_published(at_once(name), name)


@pytest.mark.parametrize("name", NAMES)
def test_live(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert_published(live(name, monkeypatch), name)


@pytest.mark.parametrize("name", NAMES)
def test_golden_files_equal_the_oracle(name: str) -> None:
    file = golden(name)
    insoles = [{key: foot[key] for key in ("foot", "layout", "boards", "calibration")} for foot in file["feet"]]
    text = regenerate.expected(log_of(name), file["about"], file["settings"], insoles)
    assert (GOLDEN / f"{name}.json").read_text() == text, "run python tests/protocol/regenerate.py"


def test_golden_files_cover_every_kind_of_cycle() -> None:
    cycles = {name: [c for foot in golden(name)["feet"] for c in foot["cycles"]] for name in NAMES}
    every = [cycle for of in cycles.values() for cycle in of]
    assert {(c["late"], c["repeated"]) for c in every} == {(False, False), (True, False), (False, True), (True, True)}
    assert any(c["missing"] for c in every)
    assert any(None in c["age_ms"] for c in every)
    assert any(max(filter(None, c["age_ms"])) > 200 for c in every)
    assert {c["cop_x_m"] is None for c in cycles["walk"]} == {True, False}
    assert {status & 15 for c in cycles["faults"] for status in c["status"]} >= {0, 1, 2, 4, 8}
    assert any(c["f_z_n"] is None for c in every)
    assert any(c["repeated"] for c in cycles["slow"])
    assert {c["seq"] for c in cycles["slow"] if c["late"]} <= set(range(10)), "nobody waits for ever"
    refused = golden("faults")["refused"]
    assert all(refused.values()), "every reason"
    assert golden("mtb3")["refused"]["overflow"] == {"5": 1}
    assert sum(path.stat().st_size for path in GOLDEN.iterdir()) < 1_000_000


@pytest.mark.parametrize(("foot", "addresses"), [("left", (5, 6, 7)), ("right", (8, 9, 10))])
def test_layouts_are_the_built_in_ones(foot: str, addresses: tuple[int, int, int]) -> None:
    layout = load(GOLDEN / f"{foot}.yaml", foot, addresses)
    assert layout.triangles == builtin(foot, addresses).triangles
    np.testing.assert_array_equal(layout.xy_m, builtin(foot, addresses).xy_m)
    assert layout.taxel_area_m2 == pytest.approx(builtin(foot, addresses).taxel_area_m2)


def test_one_cycle_a_line() -> None:
    for name in NAMES:
        lines = (GOLDEN / f"{name}.json").read_text().splitlines()
        seqs = [json.loads(line.rstrip(","))["seq"] for line in lines if line.startswith('{"seq"')]
        assert len(seqs) == sum(len(foot["cycles"]) for foot in golden(name)["feet"])


def test_the_oracle_shares_nothing_with_the_package() -> None:
    imported = [line for line in Path(oracle.__file__).read_text().splitlines() if "import" in line]
    assert not any("insole_daemon" in line or "numpy" in line for line in imported)


@pytest.mark.parametrize("name", NAMES)
def test_the_logs_can_be_made_again(name: str, tmp_path: Path) -> None:
    case = logs.cases()[name]
    log = tmp_path / "made.log"
    log.write_text("".join(frame.line() for frame in case.make()))
    assert len(list(oracle.frames(log))) == pytest.approx(len(list(oracle.frames(log_of(name)))), rel=0.1)
    stated = [{key: foot[key] for key in ("foot", "layout", "boards", "calibration")} for foot in golden(name)["feet"]]
    assert case.as_golden() == stated
    assert case.about == golden(name)["about"]
