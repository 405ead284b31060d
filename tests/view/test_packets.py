"""A cycle as bytes: what the page's other half of it reads, field for field."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from insole_daemon.config import Config
from insole_daemon.service.foot import load_feet
from insole_daemon.view.other_sources import OtherValues
from insole_daemon.view.packets import HEAD, INVALID, SATURATED, STALE, UNIT_PA, UNKNOWN, cycle_packet
from insole_daemon.wire.messages import Pressure, Raw, Wrench

FOOT = load_feet(Config())[1]
N, META = FOOT.n_triangles, FOOT.meta()
NOTHING = OtherValues((math.nan,) * 3, (math.nan,) * 3, None)
JS = (Path(__file__).parents[2] / "insole_daemon" / "view" / "page" / "packets.js").read_text()


def packet(beside=NOTHING, **change):
    counts = np.full((N, 12), 200, np.uint8)
    given = {
        "counts": counts, "status": np.zeros(N, np.uint16), "age_ms": np.full(N, 5.0, np.float32),
        "valid": np.ones((N, 12), np.uint8), "pressure_pa": np.full((N, 12), 100e3, np.float32), "f_z_n": 500.0,
    } | change  # fmt: skip
    head, missing = ("right", 7, 1, 2_000_000, 3_000_000, N), np.zeros(N, np.uint8)
    raw = Raw(
        *head, given["counts"], given["status"], np.zeros(N, np.int64), given["age_ms"], missing, given["valid"],
        False, False,
    )  # fmt: skip
    pressure = Pressure(
        *head, given["pressure_pa"], given["valid"], given["age_ms"], missing, False, "static", given["valid"] * 0
    )
    wrench = Wrench(
        *head, given["f_z_n"], 1.5, -20.0, 0.04, None, None, None, None, 0.0, 0.9, given["valid"], given["age_ms"],
        missing, False, "static", 0.0,
    )  # fmt: skip
    packed = cycle_packet(META, raw, pressure, wrench, beside)
    arrays = np.frombuffer(packed, "<u2", 2 * 12 * N, HEAD.size), np.frombuffer(packed[HEAD.size + 48 * N :], np.uint8)
    return HEAD.unpack(packed[: HEAD.size]), *arrays[0].reshape(2, N, 12), *arrays[1].reshape(2, N, 12)


def test_the_page_decodes_published_messages():
    head, units, predicted, counts, flags = packet()
    assert head[:6] == (1, 1, N, 7, 2.0, 3.0)
    assert head[6:9] == (500.0, 1.5, -20.0)
    assert head[9] == pytest.approx(0.04)
    assert math.isnan(head[10])
    assert head[11:13] == pytest.approx((0.9, 5.0))
    assert all(math.isnan(each) for each in head[13:])
    assert (units == 100e3 / UNIT_PA).all()
    assert (predicted == UNKNOWN).all()
    assert (counts == 200).all()
    assert not flags.any()
    floats = re.search(r"FLOATS = \[(.*?)\]", JS, re.DOTALL).group(1)
    assert floats.count('"') // 2 == len(head) - 6
    constants = {name: int(value, 0) for name, value in re.findall(r"(\w+) = (0x\w+|\d+)[,;]", JS)}
    assert (constants["HEAD_BYTES"], constants["UNKNOWN"]) == (HEAD.size, UNKNOWN)
    assert (constants["INVALID"], constants["STALE"], constants["SATURATED"]) == (INVALID, STALE, SATURATED)
    assert f"KPA_PER_UNIT = {UNIT_PA / 1e3:g};" in JS


def test_flags_distinguish_invalid_stale_and_saturated_taxels():
    valid, counts = np.ones((N, 12), np.uint8), np.full((N, 12), 200, np.uint8)
    age_ms, status = np.full(N, 5.0, np.float32), np.zeros(N, np.uint16)
    valid[:4], counts[1], counts[3], status[3] = 0, 0, 0, 2
    age_ms[2] = np.nan
    age_ms[4] = META.stale_after_ms + 1
    *_, flags = packet(valid=valid, counts=counts, age_ms=age_ms, status=status)
    assert [int(flags[row, 0]) for row in range(6)] == [
        INVALID, INVALID | SATURATED, INVALID | STALE, INVALID, STALE, 0,
    ]  # fmt: skip
    assert not flags[:, [6, 10]].any(), "thermal pads are no taxels of pressure"


def test_an_unknown_or_impossible_pressure_is_unknown_in_the_packet():
    pressure = np.full((N, 12), 100e3, np.float32)
    pressure[0], pressure[1], pressure[2] = np.nan, -500.0, 1e9
    _, units, *_ = packet(pressure_pa=pressure, f_z_n=None)
    assert units[:3, 0].tolist() == [UNKNOWN, 0, UNKNOWN - 1]
    head, *_ = packet(f_z_n=None)
    assert math.isnan(head[6])


def test_values_of_other_sources_are_part_of_the_packet():
    beside = OtherValues((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), np.full((N, 12), 60e3))
    head, _, predicted, *_ = packet(beside)
    assert head[13:] == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert (predicted == 60e3 / UNIT_PA).all()
