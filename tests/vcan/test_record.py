"""`insole record` on the kernel's own vcan: beside `candump`, it writes the same log."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import insole_daemon
from insole_daemon.bus.candump import read

pytestmark = pytest.mark.vcan

GOLDEN = Path(__file__).resolve().parents[2] / "protocol" / "golden"
INSOLE = Path(sys.executable).with_name("insole")
CONFIG = """
format: insole-config/1
buses: [socketcan:{vcan}]
insoles:
  - {{foot: left, boards: [{left}]}}
  - {{foot: right, boards: [{right}]}}
"""


@pytest.mark.timeout(300)
def test_a_recording_has_every_frame_of_the_bus(vcan: str, tmp_path: Path) -> None:
    boards = [f"{{address: {address}, interface: {vcan}}}" for address in range(5, 11)]
    config = tmp_path / "config.yaml"
    config.write_text(CONFIG.format(vcan=vcan, left=", ".join(boards[:3]), right=", ".join(boards[3:])))
    recorders = [
        subprocess.Popen([INSOLE, "record", tmp_path / name, "--config", config], stderr=subprocess.PIPE, text=True)
        for name in ("one", "two")  # several readers of one interface are fine
    ]
    for recorder in recorders:
        assert recorder.stderr is not None
        assert "recording socketcan:" in recorder.stderr.readline()
    subprocess.run(["canplayer", "-I", GOLDEN / "walk.log", f"{vcan}=can0"], check=True, timeout=120)
    time.sleep(1)
    recorders[0].send_signal(signal.SIGINT)
    recorders[1].kill()
    stderr = recorders[0].communicate(timeout=30)[1]
    recorders[1].communicate(timeout=30)
    golden = read(GOLDEN / "walk.log").frames
    assert recorders[0].returncode == 0, stderr
    assert re.search(rf"recorded .*, {len(golden)} frames, .* MB", stderr), stderr
    assert " lost" not in stderr, stderr
    for name in ("one", "two"):
        log = read(tmp_path / name / "can.log").frames
        np.testing.assert_array_equal(log.can_id, golden.can_id)
        np.testing.assert_array_equal(log.data, golden.data)
        assert [foot.foot for foot in insole_daemon.load(tmp_path / name).feet] == ["left", "right"]
