"""Exported recordings import again unchanged, and other programs can read them."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest
import scipy.io
from mcap.reader import make_reader

import insole_daemon
from insole_daemon.errors import FileError, InsoleError
from insole_daemon.recording.counts import CountsTable
from insole_daemon.recording.export_mcap import export_mcap
from insole_daemon.recording.export_tables import export_csv, export_cycle_table, export_matlab, export_npz
from insole_daemon.recording.importing import import_recording
from insole_daemon.recording.lab import need
from insole_daemon.recording.writer import ReferenceContents, write
from insole_daemon.skin import layout as layouts

INSOLE = Path(sys.executable).with_name("insole")


def assert_same(one, other) -> None:
    assert (one.kind, one.can_origin, one.invented) == (other.kind, other.can_origin, other.invented)
    for foot in one.feet:
        again = other[foot.foot]
        for name in ("t_ns", "counts", "valid", "status", "age_ns", "missing", "late", "repeated", "pressure_pa"):
            atol = 10 if name == "age_ns" else 0  # float32 milliseconds in between
            np.testing.assert_allclose(getattr(foot, name), getattr(again, name), rtol=0, atol=atol, err_msg=name)
        for name in type(foot.wrench).__slots__:
            np.testing.assert_array_equal(getattr(foot.wrench, name), getattr(again.wrench, name))
        np.testing.assert_array_equal(foot.reference.time_s, again.reference.time_s)
        assert foot.boards == again.boards


def test_an_exported_mcap_imports_as_the_same_recording(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    export_mcap(loaded, tmp_path / "x.mcap")
    again = import_recording(tmp_path / "x.mcap", tmp_path / "again", None, None, None)
    assert_same(loaded, insole_daemon.load(again))


def test_an_exported_mcap_of_counts_imports_as_the_same_recording(tmp_path, left, reference):
    counts = np.random.default_rng(4).integers(1, 255, (60, len(left.layout), 12), np.uint8)
    t_ns = 1_760_000_000_000_000_000 + np.arange(60) * 20_000_000
    folder = write(
        tmp_path / "counted", kind="chamber", can_origin="reencoded", insoles=[left], invented=["times"],
        counts={"left": CountsTable(t_ns, counts)}, reference=[reference],
    )  # fmt: skip
    loaded = insole_daemon.load(folder)
    export_mcap(loaded, tmp_path / "x.mcap")
    again = import_recording(tmp_path / "x.mcap", tmp_path / "again", None, None, None)
    assert_same(loaded, insole_daemon.load(again))


def test_mcap_has_the_encodings_that_foxglove_and_plotjuggler_read(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    export_mcap(loaded, tmp_path / "x.mcap")
    foot = loaded["left"]
    by_schema: dict[str, list] = {}
    with open(tmp_path / "x.mcap", "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        before = 0
        for schema, channel, message in reader.iter_messages():
            if schema.name.startswith("foxglove."):
                continue  # tests/recording/test_round_trips.py
            assert schema.encoding == "jsonschema"
            assert channel.message_encoding == "json"
            assert message.log_time >= before
            before = message.log_time
            content, grammar = json.loads(message.data), json.loads(schema.data)
            assert grammar["type"] == "object"
            jsonschema.validate(content, {**grammar, "additionalProperties": False})
            assert None not in content.values()
            # Foxglove's reader of schemas knows single types only
            assert all(isinstance(entry["type"], str) for entry in grammar["properties"].values())
            by_schema.setdefault(channel.topic, []).append((message.log_time, content))
        attached = {entry.name: entry for entry in reader.iter_attachments()}
        content = {entry.name: entry.metadata for entry in reader.iter_metadata()}
    assert set(by_schema) == {f"/insole/left/{what}" for what in ("wrench", "health", "event", "step", "reference")}
    wrench = by_schema["/insole/left/wrench"]
    assert [t for t, _ in wrench] == foot.t_ns.tolist()
    np.testing.assert_array_equal([w["f_z_n"] for _, w in wrench], foot.wrench.f_z_n)
    assert [w.get("cop_x_m") is None for _, w in wrench] == np.isnan(foot.wrench.cop_x_m).tolist()
    assert len(by_schema["/insole/left/health"]) in (3, 4)
    health = by_schema["/insole/left/health"][1][1]
    assert health["state"] == "ok"
    assert 45 < health["publish_rate_hz"] < 55
    assert [event["text"] for _, event in by_schema["/insole/left/event"]] == [
        f"board {address}: never seen → streaming" for address in (5, 6, 7)
    ]
    assert len(by_schema["/insole/left/reference"]) == 60
    assert "pressure_pa" not in by_schema["/insole/left/reference"][7][1], "a missing value is left out"
    assert {"recording.yaml", "can.log.gz", "left-calibration.json", "left-layout.yaml"} <= attached.keys()
    assert attached["left-calibration.json"].media_type == "application/json"
    assert content["insole-recording"]["can_origin"] == "simulated"
    assert content["insole-recording"]["left_reference_clock"] == "that of the frames"


def test_a_reference_on_its_own_clock_is_marked_as_not_aligned(tmp_path, left, walk):
    metadata = []
    for number, columns in enumerate(
        ({"pressure_pa": np.ones(3)}, {"time_s": np.arange(3.0), "pressure_pa": np.ones(3)},
         {"time_s": np.arange(3.0), "pressure_pa": np.ones(3), "received_s": 1_760_000_001.0 + np.arange(3)})
    ):  # fmt: skip
        folder = write(
            tmp_path / f"{number}", kind="chamber", can_origin="simulated", insoles=[left], frames=[walk],
            reference=[ReferenceContents("left", "own", columns)],
        )  # fmt: skip
        export_mcap(insole_daemon.load(folder), tmp_path / f"{number}.mcap")
        with open(tmp_path / f"{number}.mcap", "rb") as file:
            reader = make_reader(file)
            times = [m.log_time for _, channel, m in reader.iter_messages() if channel.topic.endswith("reference")]
            metadata.append((len(times), *next(iter(reader.iter_metadata())).metadata.values()))
        if number == 2:
            assert times[0] == 1_760_000_001_000_000_000
    assert [entry[0] for entry in metadata] == [0, 3, 3]
    for entry, words in zip(metadata, ("unknown: no times", "true offset is not known", "arrived"), strict=True):
        assert words in entry[-1]


def test_an_mcap_without_a_recording_is_refused(tmp_path):
    (tmp_path / "x.mcap").write_bytes(b"none at all")
    with pytest.raises(InsoleError, match="expected an MCAP file"):
        import_recording(tmp_path / "x.mcap", tmp_path / "out", None, None, None)
    from mcap.writer import Writer

    for name in ("notes.txt", "../recording.yaml"):
        with open(tmp_path / "x.mcap", "wb") as file:
            writer = Writer(file)
            writer.start()
            writer.add_attachment(0, 0, name, "text/plain", b"hello")
            writer.finish()
        with pytest.raises(InsoleError, match="expected an MCAP file with a recording in its attachments"):
            import_recording(tmp_path / "x.mcap", tmp_path / "out", None, None, None)
    assert not (tmp_path / "out").exists()


def test_exported_csv_imports_as_the_same_counts(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    export_csv(loaded, tmp_path / "tables")
    layout = layouts.load(tmp_path / "tables" / "left-layout.yaml")
    again = insole_daemon.load(
        import_recording(tmp_path / "tables" / "left-counts.csv", tmp_path / "again", "left", layout, None)
    )["left"]
    foot = loaded["left"]
    np.testing.assert_array_equal(again.counts, foot.counts)
    np.testing.assert_array_equal(again.t_ns, foot.t_ns)
    pressure = np.genfromtxt(tmp_path / "tables" / "left-pressure.csv", delimiter=",", names=True)
    np.testing.assert_allclose(pressure["pressure_pa_5_0_3"], foot.pressure_pa[:, 0, 3], rtol=1e-6)
    wrench = np.genfromtxt(tmp_path / "tables" / "left-wrench.csv", delimiter=",", names=True)
    np.testing.assert_allclose(wrench["f_z_n"], foot.wrench.f_z_n, rtol=1e-8)
    reference = (tmp_path / "tables" / "left-reference.csv").read_text().splitlines()
    assert reference[0] == "time_s,pressure_pa,temperature_c"
    assert reference[8].split(",")[1] == ""


def test_one_csv_file_has_the_forces_of_each_cycle(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    export_cycle_table(loaded, tmp_path / "forces.csv")
    foot = loaded["left"]
    table = np.genfromtxt(tmp_path / "forces.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert set(table["foot"].tolist()) == {"left"}
    np.testing.assert_allclose(table["time_s"], foot.t_ns * 1e-9, atol=1e-6)
    for name in ("f_z_n", "cop_x_m", "valid_fraction"):
        np.testing.assert_allclose(table[name], getattr(foot.wrench, name), rtol=1e-8)
    pressure_pa = np.where(foot.valid, foot.pressure_pa, np.nan).reshape(len(foot), -1)
    np.testing.assert_allclose(table["peak_pa"], np.nanmax(pressure_pa, axis=1), rtol=1e-6)
    np.testing.assert_allclose(table["mean_pa"], np.nanmean(pressure_pa, axis=1), rtol=1e-5)


def test_forces_of_both_feet_are_in_order_of_time(trial, tmp_path):
    left = insole_daemon.load(trial)["left"]
    right = replace(left, foot="right", t_ns=left.t_ns + 7_000_000)
    export_cycle_table(SimpleNamespace(feet=(left, right)), tmp_path / "forces.csv")
    rows = [line.split(",") for line in (tmp_path / "forces.csv").read_text().splitlines()[1:]]
    assert [row[1] for row in rows[:4]] == ["left", "right", "left", "right"]
    assert [float(row[0]) for row in rows] == sorted(float(row[0]) for row in rows)


def test_exporting_forces_without_a_calibration_is_refused_with_a_remedy(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    without = SimpleNamespace(feet=(replace(loaded["left"], wrench=None),), folder=trial)
    with pytest.raises(FileError, match="no foot has a calibration.*--to csv"):
        export_cycle_table(without, tmp_path / "forces.csv")
    assert not (tmp_path / "forces.csv").exists()


def test_npz_and_matlab_contain_all_arrays(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    foot = loaded["left"]
    export_npz(loaded, tmp_path / "x.npz")
    export_matlab(loaded, tmp_path / "x.mat")
    with np.load(tmp_path / "x.npz", allow_pickle=False) as archive:
        arrays = dict(archive)
    matlab = scipy.io.loadmat(tmp_path / "x.mat", squeeze_me=True, simplify_cells=True)
    assert matlab["recording"]["can_origin"] == str(arrays["can_origin"]) == "simulated"
    for exported in (arrays, matlab["left"]):
        np.testing.assert_array_equal(exported["counts"], foot.counts)
        np.testing.assert_array_equal(exported["t_ns"], foot.t_ns)
        np.testing.assert_array_equal(exported["valid"].astype(bool), foot.valid)
        np.testing.assert_array_equal(exported["pressure_pa"], foot.pressure_pa)
        np.testing.assert_array_equal(exported["f_z_n"], foot.wrench.f_z_n)
        np.testing.assert_array_equal(exported["reference_pressure_pa"], foot.reference["pressure_pa"])
        np.testing.assert_allclose(exported["xy_m"], foot.layout.xy_m)


def test_an_exported_npz_is_readable_as_counts_npz(trial, tmp_path):
    loaded = insole_daemon.load(trial)
    export_npz(loaded, trial / "counts.npz")
    text = (trial / "recording.yaml").read_text()
    (trial / "recording.yaml").write_text(text.replace("can: can.log", "counts: counts.npz"))
    assert_same(loaded, insole_daemon.load(trial))


def test_import_and_export_commands_round_trip(trial, tmp_path):
    for status, words in ((0, "x.mcap: mcap, left 150 cycles"), (4, "is already there")):
        done = subprocess.run(
            [INSOLE, "export", trial, tmp_path / "x.mcap"], capture_output=True, text=True, check=False
        )
        assert done.returncode == status
        assert words in done.stdout + done.stderr
    done = subprocess.run(
        [INSOLE, "import", tmp_path / "x.mcap", tmp_path / "again"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "150 cycles, 28 triangles, chamber" in done.stdout
    assert "invented: the layout of the left foot: the built-in approximation" in done.stderr
    assert_same(insole_daemon.load(trial), insole_daemon.load(tmp_path / "again"))


def test_a_missing_package_is_named_with_its_extra():
    with pytest.raises(InsoleError, match=r"reading nothing needs the package nowhere.*lab"):
        need("insole_nowhere", "nowhere", "reading nothing")
