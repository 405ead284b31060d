"""The LSL outlet against a real daemon, read by a real LSL inlet in a process of its own."""

from __future__ import annotations

import dataclasses
import json
import math
import platform
import signal
import time
import uuid

import numpy as np
import pytest
from processes import EXAMPLES, lacking, python, run_to_end

import insole_daemon
from insole_daemon.wire.publisher import FootPublisher
from insole_daemon.wire.session import open_session

if platform.machine() != "x86_64":
    pytest.skip("pylsl has wheels with liblsl for x86-64 alone", allow_module_level=True)
try:
    import pylsl  # noqa: F401 - it raises RuntimeError where it finds no liblsl
except (ImportError, RuntimeError) as error:
    lacking(f"pylsl with liblsl: {error}")

INLET = """
import json, sys, time
import pylsl
(found,) = pylsl.resolve_byprop("source_id", sys.argv[1], 1, 20)
inlet = pylsl.StreamInlet(found)
info = inlet.info(5)
print(json.dumps({
    "name": info.name(), "type": info.type(), "rate_hz": info.nominal_srate(), "host": info.hostname(),
    "labels": info.get_channel_labels(), "units": info.get_channel_units(),
    "calibration": info.desc().child_value("calibration"),
}))
inlet.open_stream(5)
print(json.dumps("open"), flush=True)
while True:
    row, stamp = inlet.pull_sample()
    print(json.dumps([stamp + time.time() - pylsl.local_clock(), row]))
"""


@pytest.fixture
def lsl(tmp_path):
    """LSL that sends to 127.0.0.1 alone, and is not found by, and does not find, anybody else's streams."""
    config = tmp_path / "lsl_api.cfg"
    config.write_text(
        f"[lab]\nSessionID = {uuid.uuid4()}\n[ports]\nIPv6 = disable\n"
        "[multicast]\nAddressesOverride = {127.0.0.1}\nListenAddress = 127.0.0.1\n[log]\nlevel = -3\n"
    )
    return {"LSLAPICFG": str(config)}


def test_rows_have_the_values_and_the_time_of_the_cycles(daemon, lsl):
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        meta = insole.meta("left")
        sent = insole.wrenches("left")
        with (
            python(EXAMPLES / "lsl_outlet.py", "left", daemon.endpoint, **lsl) as outlet,
            python("-c", INLET, "insole/test/left/wrench", **lsl) as inlet,
        ):
            head, _, *rows = map(json.loads, inlet.take(202))
            outlet.process.send_signal(signal.SIGINT)
            assert outlet.process.wait() == 0
        insole.close()
        wrenches = list(sent)

    assert (head["name"], head["type"], head["rate_hz"]) == ("insole_left", "Force", 50)
    assert head["labels"] == ["f_z", "m_x", "m_y", "cop_x", "cop_y", "valid_fraction"]
    assert head["units"] == ["N", "N.m", "N.m", "m", "m", "1"]
    assert head["calibration"] == meta.calibration
    first = min(range(len(wrenches)), key=lambda i: abs(wrenches[i].t_ns - rows[0][0] * 1e9))
    errors_s = []
    for (stamp, row), wrench in zip(rows, wrenches[first:], strict=False):
        errors_s.append(stamp - wrench.t_ns * 1e-9)
        fields = ("f_z_n", "m_x_nm", "m_y_nm", "cop_x_m", "cop_y_m", "valid_fraction")
        values = [getattr(wrench, field) for field in fields]
        np.testing.assert_array_equal(row, np.array([math.nan if v is None else v for v in values], np.float32))
    assert len(errors_s) == 200
    assert np.median(np.abs(errors_s)) < 0.0005, "the time of the reading, not of the sending"
    assert np.percentile(np.abs(errors_s), 90) < 0.005


def test_without_an_answering_daemon_it_ends_with_one_message(endpoint, lsl):
    status, (message,) = run_to_end("lsl_outlet.py", "left", endpoint, **lsl)
    assert status == 1
    assert message.startswith(f"lsl_outlet: nobody answers on {endpoint}. Start the daemon")


def test_unknown_lost_and_repeated(daemon, endpoint, lsl):
    """Cycles made by hand: a force that is not known, a gap of two, a repeat."""
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        meta, wrench = insole.meta("left"), next(insole.wrenches("left"))
    daemon.end()  # its place is taken here

    unknown = {"f_z_n": None, "m_x_nm": None, "m_y_nm": None, "cop_x_m": None, "cop_y_m": None}
    begun = time.time_ns()

    def cycle(seq, t_ms, published_ms, **fields):
        times = {"t_ns": begun + t_ms * 1_000_000, "t_published_ns": begun + published_ms * 1_000_000}
        return dataclasses.replace(wrench, seq=seq, lost=0, **times, **fields)

    with open_session("peer", [endpoint]) as session, FootPublisher(session, "made", "left") as publisher:
        publisher.publish_latched("meta", dataclasses.replace(meta, rig="made"))
        publisher.announce()
        with (
            python(EXAMPLES / "lsl_outlet.py", "left", endpoint, **lsl),
            python("-c", INLET, "insole/made/left/wrench", **lsl) as inlet,
        ):
            inlet.take(2)
            time.sleep(0.5)  # the outlet is there before it subscribes
            publisher.publish(cycle(5, 0, 1, f_z_n=100.0))
            publisher.publish(cycle(6, 20, 21, **unknown))
            publisher.publish(cycle(9, 80, 81, f_z_n=200.0))
            publisher.publish(cycle(10, 80, 101, f_z_n=200.0, repeated=True))
            rows = [json.loads(line) for line in inlet.take(6)]
    forces = [row[0] for _, row in rows]
    np.testing.assert_array_equal(forces, [100, np.nan, np.nan, np.nan, 200, 200])
    assert rows[1][1][5] == pytest.approx(wrench.valid_fraction), "what is known stays known"
    assert all(math.isnan(value) for _, row in rows[2:4] for value in row)
    stamps_ms = [(stamp - begun * 1e-9) * 1e3 for stamp, _ in rows]
    assert stamps_ms == pytest.approx([0, 20, 40, 60, 80, 101], abs=2)
