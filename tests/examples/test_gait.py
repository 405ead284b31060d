"""The Python of docs/gait.md, as it stands there."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
from processes import ROOT

from insole_daemon.config import Config
from insole_daemon.mechanics.region_map import BUILTIN
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.trial import Trial


def test_the_calls_of_the_document_run(tmp_path, monkeypatch, capsys):
    config = Config()
    layouts = [load_layout(insole) for insole in config.insoles]
    for name, task in (("walk-1", "t4"), ("walk-2", "t5")):
        Trial(task, config, layouts, seed=1).write(tmp_path / name, 20.0)
    shutil.copy(BUILTIN, tmp_path / "my-regions.yaml")
    document = (ROOT / "docs" / "gait.md").read_text()
    (mapping,) = re.findall(r"```yaml\n(.*?)```", document, re.DOTALL)
    (tmp_path / "other.yaml").write_text(mapping)
    t_s = np.arange(0, 20, 0.02)
    rows = [f"{1e3 * t:.0f};{f:.2f}" for t, f in zip(t_s, 600 * np.maximum(np.sin(5.7 * t_s), 0), strict=True)]
    (tmp_path / "other.csv").write_text("\n".join(["Time [ms];Fz [N]", *rows]).replace(".", ",") + "\n")
    (tmp_path / "found").mkdir()
    shutil.copy(tmp_path / "walk-2" / "left-calibration.json", tmp_path / "found" / "model.json")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", document, re.DOTALL)
    assert len(blocks) == 6
    own_s = np.cumsum(np.random.default_rng(1).uniform(2, 9, 12))
    names = {"insole_markers_s": own_s, "camera_markers_s": 0.8 + own_s * (1 + 80e-6)}
    for block in blocks:
        exec(compile(block, "docs/gait.md", "exec"), names)  # noqa: S102
    (gain,) = re.findall(r"forces and pressures times ([\d.]+):", names["scaled"].remarks[-1])
    assert float(gain) == pytest.approx(1.0, abs=0.02)
    assert "steady" in capsys.readouterr().out
    assert len(names["steps"]) == len(names["table"])
    assert len(names["corrected"].steady) > 10
    assert len(names["other"].steady) > 10
    assert abs(names["clock"].offset_s - 0.8) < 0.002
