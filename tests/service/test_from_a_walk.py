"""From a walk with a force shoe to the right forces live: recorded, diagnosed, run, subscribed, nobody in between."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon import config as configs
from insole_daemon.physics.effect import effect
from insole_daemon.service.foot_setup import load_layout
from insole_daemon.simulation.foot import Walk
from insole_daemon.simulation.trial import Trial

INSOLE = str(Path(sys.executable).with_name("insole"))
CONFIG = """\
format: insole-config/1
rig: test
insoles:
  - foot: left
    calibration: found/model.json
    boards: [{{address: 5, interface: can0}}, {{address: 6, interface: can0}}, {{address: 7, interface: can0}}]
zenoh:
  listen: [{endpoint}]
"""
SOFT = effect("viscoelasticity", a=0.5, tau_s=0.3)


@pytest.mark.xfail(reason="open: with half of the answer late, the regression's model is not yet checked live")
def test_an_effect_diagnosed_on_one_walk_is_compensated_on_another(daemon, tmp_path):
    daemon.end()
    daemon.config_file.write_text(CONFIG.format(endpoint=daemon.endpoint))
    config = configs.load(daemon.config_file)
    layouts = [load_layout(insole) for insole in config.insoles]
    trial, live = (Trial(name, config, layouts, effects={"left": (SOFT,)}, seed=4) for name in ("t4", "walk"))
    trial.write(tmp_path / "walk", 40.0)
    out = daemon.config_file.parent / "found"
    done = subprocess.run(
        [INSOLE, "diagnose", tmp_path / "walk", "--out", out], capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    findings = json.loads((out / "diagnosis.json").read_text())["findings"]
    assert findings[0]["effect"] == "viscoelasticity", done.stdout

    daemon.start()
    with daemon.played(live.emulator) as emulator, insole_daemon.connect(daemon.endpoint) as insole:
        wrenches, models = insole.wrenches("left"), insole.models("left")
        stamps = {message.seq: message.t_ns for message in islice(wrenches, 400)}
        forces = {message.seq: (message.static_f_z_n, message.dynamic_f_z_n) for message in islice(models, 400)}
        began_ns = emulator.playing_since_ns
    assert began_ns is not None
    both = [seq for seq in stamps if None not in forces.get(seq, (None,))]
    t_s = np.array([stamps[seq] - began_ns for seq in both]) * 1e-9
    assert isinstance(live.load, Walk)
    off = np.array([forces[seq] for seq in both], float) - live.load.force_n("left", t_s)[:, None]
    assert len(both) > 200
    static_n, dynamic_n = np.sqrt(np.mean(off[t_s > 2.0] ** 2, axis=0))
    assert dynamic_n < 0.5 * static_n
