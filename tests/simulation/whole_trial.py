"""The SHA-256 of a short recording with every kind of arithmetic in it; run by the tests in a process of its own."""

import hashlib
import sys
import tempfile
from pathlib import Path

from insole_daemon.config import Config
from insole_daemon.physics.effect import Where, effect
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.simulation.conditions import Conditions
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
EFFECTS = [
    effect("map_transform", x_mm=2.0, y_mm=-1.0, rotation_deg=1.0, scale=1.0),
    effect("crosstalk", k=0.1),
    effect("hysteresis", r_pa=[500.0, 8000.0], w=[0.02, 0.03]),
    effect("creep", a=[0.01, 0.02], tau_s=[2.0, 20.0]),
    effect("lag", tau_s=0.015),
    effect("temperature", count_per_k=0.3, gain_per_k=0.003, t0_c=25.0),
    effect("bit_shift", Where("board", ((6,),)), shift=2),
    effect("delay", delay_s=0.02),
]


def digest(folder: Path) -> str:
    """Of every file, in the order of their names."""
    found = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        found.update(path.name.encode() + path.read_bytes())
    return found.hexdigest()


def main() -> None:
    config = Config(insoles=Config().insoles[:1])
    trial = Trial("t4", config, [LEFT], effects={"left": EFFECTS}, seed=7, conditions=Conditions(cdc_hz=CDC_HZ))
    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(digest(trial.write(Path(folder) / "t4", 5.0)))


if __name__ == "__main__":
    main()
