"""Other libraries read steps, pressure and forces from every exported format."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
from pathlib import Path

import c3d
import numpy as np
import pandas as pd
import pyarrow.parquet
import pytest
import scipy.io
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import insole_daemon
from insole_daemon.config import Config
from insole_daemon.errors import InsoleError
from insole_daemon.recording import foxglove
from insole_daemon.recording.export_c3d import export_c3d
from insole_daemon.recording.export_mcap import export_mcap
from insole_daemon.recording.export_tables import export_csv, export_cycle_table, export_matlab, export_parquet
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin.geometry import PRESSURE_TAXELS

INSOLE = Path(sys.executable).with_name("insole")
CONFIG = Config()


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    layouts = [load_layout(insole) for insole in CONFIG.insoles]
    folder = Trial("t5", CONFIG, layouts, seed=3).write(tmp_path_factory.mktemp("trial") / "walk", 12.0)
    return insole_daemon.load(folder)


def assert_steps(steps, frame: pd.DataFrame, rtol: float = 0.0) -> None:
    assert list(frame.columns) == list(steps.columns)
    for name, column in steps.columns.items():
        if name in ("foot", "label"):
            assert [str(cell).strip() for cell in frame[name]] == column.tolist()
        else:
            np.testing.assert_allclose(frame[name].to_numpy(float), column, rtol=rtol, err_msg=name)


def test_pandas_reads_the_exported_csv(walk, tmp_path):
    export_csv(walk, tmp_path / "tables")
    assert_steps(walk.steps, pd.read_csv(tmp_path / "tables" / "steps.csv"), rtol=1e-8)
    pressure = pd.read_csv(tmp_path / "tables" / "left-pressure.csv").to_numpy()[:, 1:]
    left = walk["left"]
    np.testing.assert_allclose(pressure, left.pressure_pa.reshape(len(left), -1), rtol=1e-6)


def heel_pressures_pa(foot) -> np.ndarray:
    """(n, k) of the taxels in the rear 27 % of the sensed area's length; NaN where not valid."""
    x = foot.layout.xy_m[..., 0]
    low, high = x[:, PRESSURE_TAXELS].min(), x[:, PRESSURE_TAXELS].max()
    is_heel = (x < low + 0.27 * (high - low)) & PRESSURE_TAXELS
    return np.where(foot.valid, foot.pressure_pa, np.nan)[:, is_heel]


def test_pandas_reads_force_and_pressure_of_both_feet_from_one_csv_file(walk, tmp_path):
    export_cycle_table(walk, tmp_path / "walk.csv")
    table = pd.read_csv(tmp_path / "walk.csv")
    assert set(table.foot) == {"left", "right"}
    for foot in walk.feet:
        rows, heel_pa = table[table.foot == foot.foot], heel_pressures_pa(foot)
        np.testing.assert_allclose(rows.f_z_n, foot.wrench.f_z_n, rtol=1e-8)
        np.testing.assert_allclose(rows.heel_peak_pa, heel_pa.max(axis=1), rtol=1e-6)
        np.testing.assert_allclose(rows.heel_mean_pa, heel_pa.mean(axis=1, dtype=np.float64), rtol=1e-6, atol=1e-3)
        assert rows.heel_peak_pa.max() > 100e3, "a heel strike"
        named = ["heel", "midfoot", *(f"metatarsal_{n}" for n in range(1, 6)), "hallux", "toes"]
        peaks = rows[[f"{region}_peak_pa" for region in named]]
        np.testing.assert_allclose(peaks.max(axis=1), rows.peak_pa, rtol=1e-6)  # the regions cover the sole


def test_scipy_reads_the_exported_matlab_file(walk, tmp_path):
    export_matlab(walk, tmp_path / "x.mat")
    content = scipy.io.loadmat(tmp_path / "x.mat", squeeze_me=True, simplify_cells=True)
    steps = content["steps"]
    assert_steps(walk.steps, pd.DataFrame({name: steps[name] for name in walk.steps.columns}))
    np.testing.assert_array_equal(steps["curve_f_z_n"], walk.steps.curves["f_z_n"])


def test_pandas_and_pyarrow_read_the_exported_parquet(walk, tmp_path):
    export_parquet(walk, tmp_path / "tables")
    assert_steps(walk.steps, pd.read_parquet(tmp_path / "tables" / "steps.parquet"))
    table = pyarrow.parquet.read_table(tmp_path / "tables" / "left.parquet")
    left = walk["left"]
    pressure = table["pressure_pa"].combine_chunks().flatten().to_numpy().reshape(left.pressure_pa.shape)
    np.testing.assert_array_equal(pressure, left.pressure_pa)
    np.testing.assert_array_equal(table["f_z_n"].to_numpy(), left.wrench.f_z_n)
    assert table.schema.metadata[b"foot"] == b"left"
    reference = pd.read_parquet(tmp_path / "tables" / "left-reference.parquet")
    np.testing.assert_array_equal(reference["fz_n"], left.reference["fz_n"])


def test_the_protobuf_reader_reads_the_exported_mcap(walk, tmp_path):
    export_mcap(walk, tmp_path / "x.mcap")
    by_schema: dict[str, list] = {}
    with open(tmp_path / "x.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        topics = ["/insole/left/pressure", "/insole/log", "/tf"]
        for _, _, message, decoded in reader.iter_decoded_messages(topics=topics):
            by_schema.setdefault(decoded.DESCRIPTOR.full_name, []).append((message.log_time, decoded))
    clouds, left = by_schema["foxglove.PointCloud"], walk["left"]
    assert [t for t, _ in clouds] == left.t_ns.tolist()
    for row in (0, 300, len(left) - 1):
        cloud = clouds[row][1]
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "pressure_pa"]
        points = np.frombuffer(cloud.data, "<f4").reshape(-1, 4)
        np.testing.assert_allclose(points[:, :2], left.layout.xy_m[:, PRESSURE_TAXELS].reshape(-1, 2), atol=1e-7)
        expected = np.where(left.valid[row], left.pressure_pa[row], np.nan)[:, PRESSURE_TAXELS].ravel()
        np.testing.assert_array_equal(points[:, 3], expected)
        assert cloud.timestamp.ToNanoseconds() == left.t_ns[row]
    assert len(by_schema["foxglove.Log"]) == len(walk.steps)
    assert {transform.child_frame_id for transform in by_schema["foxglove.FrameTransforms"][0][1].transforms} >= {
        clouds[0][1].frame_id
    }


def test_every_topic_and_field_of_the_foxglove_layout_is_in_the_export(walk, tmp_path):
    export_mcap(walk, tmp_path / "x.mcap")
    layout = json.loads(foxglove.LAYOUT.read_text())
    with open(tmp_path / "x.mcap", "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        schemas = {channel.topic: schema for schema, channel, _ in reader.iter_messages()}
        clouds = {channel.topic: cloud for _, channel, _, cloud in reader.iter_decoded_messages(
            topics=[topic for topic in schemas if topic.endswith("/pressure")])}  # fmt: skip
    panels = layout["configById"]
    for topic, style in panels["3D!pressure"]["topics"].items():
        assert style["colorField"] in [field.name for field in clouds[topic].fields]
    for plot in ("Plot!force", "Plot!steps"):
        for path in panels[plot]["paths"]:
            topic, _, field = path["value"].partition(".")
            assert field in json.loads(schemas[topic].data)["properties"]
    assert schemas[panels["RosOut!steps"]["topicToRender"]].name == "foxglove.Log"

    def names(node):
        return {node} if isinstance(node, str) else names(node["first"]) | names(node["second"])

    assert names(layout["layout"]) == panels.keys()


@pytest.mark.parametrize("schema", [PointCloud, Log, FrameTransforms])
def test_exported_mcap_has_the_published_foxglove_schemas(walk, tmp_path, schema):
    """No message may have a field that is missing in the published schema either."""
    export_mcap(walk, tmp_path / "x.mcap")
    published = schema.DESCRIPTOR
    with open(tmp_path / "x.mcap", "rb") as file:
        messages = [entry for entry in make_reader(file).iter_messages() if entry[0].name == published.full_name]
    descriptors = FileDescriptorSet.FromString(messages[0][0].data)
    (descriptor,) = [entry for entry in descriptors.file if entry.name == published.file.name]
    assert descriptor.SerializeToString() == published.file.serialized_pb
    for _, _, message in messages:
        parsed = schema.FromString(message.data)
        assert parsed.SerializeToString(deterministic=True)
        parsed.DiscardUnknownFields()
        assert parsed == schema.FromString(message.data)


def test_the_c3d_package_reads_the_exported_c3d(walk, tmp_path):
    export_c3d(walk, tmp_path / "x.c3d")
    with open(tmp_path / "x.c3d", "rb") as file:
        reader = c3d.Reader(file)
        assert reader.point_rate == 50.0
        labels = [label.strip() for label in reader.analog_labels]
        frames = np.concatenate([analog for _, _, analog in reader.read_frames()], axis=1)
    f_z, heel_kpa = frames[labels.index("L_Fz")], frames[labels.index("L_heel_peak")]
    left = walk["left"]
    t_ns = max(foot.t_ns[0] for foot in walk.feet) + np.arange(len(f_z)) * 20_000_000
    expected = np.interp(t_ns - t_ns[0], left.t_ns - t_ns[0], left.wrench.f_z_n)
    np.testing.assert_allclose(f_z, expected, rtol=1e-6, atol=1e-3)
    expected_pa = np.interp(t_ns - t_ns[0], left.t_ns - t_ns[0], heel_pressures_pa(left).max(axis=1))
    np.testing.assert_allclose(heel_kpa, expected_pa / 1e3, rtol=1e-6, atol=1e-3)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="ezc3d has wheels for x86-64 alone; c3d reads it elsewhere")
def test_ezc3d_reads_force_pressure_cop_and_events(walk, tmp_path):
    import ezc3d

    export_c3d(walk, tmp_path / "x.c3d")
    content = ezc3d.c3d(str(tmp_path / "x.c3d"), extract_forceplat_data=True)
    for number, foot in enumerate(("left", "right")):
        plate = content["data"]["platform"][number]
        points = content["data"]["points"][:3, number]
        loaded = plate["force"][2] < -100.0
        assert np.count_nonzero(loaded) > 100
        assert -plate["force"][2].min() == pytest.approx(np.nanmax(walk[foot].wrench.f_z_n), rel=0.03)
        cop = plate["center_of_pressure"][:, loaded]
        # both are interpolated between cycles: the ratio of what is interpolated is not the interpolated ratio
        assert np.nanmedian(np.abs(cop[:2] - points[:2, loaded])) < 0.5
    analog = content["parameters"]["ANALOG"]
    units = dict(zip(analog["LABELS"]["value"], analog["UNITS"]["value"], strict=True))
    assert (units["L_Fz"], units["L_Mx"], units["R_mean"], units["R_toes_peak"]) == ("N", "Nmm", "kPa", "kPa")
    channels = dict(zip(analog["LABELS"]["value"], content["data"]["analogs"][0], strict=True))
    for foot in walk.feet:
        peak_pa = np.nanmax(np.where(foot.valid, foot.pressure_pa, np.nan))
        assert np.nanmax(channels[f"{foot.foot[0].upper()}_peak"]) == pytest.approx(peak_pa / 1e3, rel=0.03)
    events = content["parameters"]["EVENT"]
    minutes, seconds = events["TIMES"]["value"]
    strikes = [
        60 * m + s
        for m, s, word, side in zip(
            minutes, seconds, events["LABELS"]["value"], events["CONTEXTS"]["value"], strict=True
        )
        if (word, side.strip()) == ("Foot Strike", "Left")
    ]
    contact_s = walk.steps.of("left")["contact_s"]
    offset_s = (walk.steps.start_ns - int(content["parameters"]["INSOLE"]["START_NS"]["value"][0])) * 1e-9
    np.testing.assert_allclose(strikes, contact_s[np.isfinite(contact_s)] + offset_s, atol=1e-4)


class ManySteps(dict):
    """Columns of any number of steps, half a second apart."""

    def __init__(self, number: int, start_ns: int) -> None:
        self.start_ns = start_ns
        at_s = np.arange(number) * 0.5
        foot, label = np.array(["left", "right"])[np.arange(number) % 2], np.full(number, "steady")
        super().__init__(contact_s=at_s, toe_off_s=at_s + 0.3, foot=foot, label=label)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="ezc3d has wheels for x86-64 alone; c3d reads it elsewhere")
def test_c3d_contains_the_events_of_a_long_walk(walk, tmp_path, monkeypatch):
    import ezc3d

    start_ns = int(max(foot.t_ns[0] for foot in walk.feet))
    steps = ManySteps(1000, start_ns)
    monkeypatch.setitem(walk.__dict__, "steps", steps)
    export_c3d(walk, tmp_path / "x.c3d")
    events = ezc3d.c3d(str(tmp_path / "x.c3d"))["parameters"]["EVENT"]
    numbers = ["", *map(str, range(2, 9))]
    minutes, seconds = np.concatenate([events[f"TIMES{number}"]["value"] for number in numbers], axis=1)
    at_s = np.sort(np.concatenate([steps["contact_s"], steps["toe_off_s"]]))
    assert events["USED"]["value"][0] == len(minutes) == 2000
    assert sum(len(events[f"LABELS{number}"]["value"]) for number in numbers) == 2000
    np.testing.assert_allclose(minutes * 60 + seconds, at_s, rtol=1e-6)

    monkeypatch.setitem(walk.__dict__, "steps", ManySteps(5000, start_ns))
    with pytest.raises(InsoleError, match="C3D has no room for"):
        export_c3d(walk, tmp_path / "y.c3d")
    assert not (tmp_path / "y.c3d").exists()


def test_c3d_without_a_calibration_is_refused(walk, tmp_path):
    from dataclasses import replace

    blind = replace(
        walk, feet=tuple(replace(foot, wrench=None, pressure_pa=None, calibration=None) for foot in walk.feet)
    )
    with pytest.raises(InsoleError, match="no foot has a calibration"):
        export_c3d(blind, tmp_path / "x.c3d")
    assert not list(tmp_path.iterdir())
    export_csv(blind, tmp_path / "tables")
    assert len(pd.read_csv(tmp_path / "tables" / "steps.csv")) == 0


@pytest.mark.parametrize("name", ["x.c3d", "x.parquet"])
def test_the_export_command_writes_every_format(walk, tmp_path, name):
    done = subprocess.run([INSOLE, "export", walk.folder, tmp_path / name], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / name).exists()
