"""Print the SHA-256 of a short recording with every kind of arithmetic; tests run it in another process."""

import hashlib
import sys
import tempfile
from pathlib import Path

from insole_daemon.config import Config
from insole_daemon.physics.effect import Where, effect
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.simulation.trial import Trial
from insole_daemon.skin import layout as layouts

LEFT = layouts.builtin("left", (5, 6, 7))
ONE_BOARD = Where("board", ((6,),))
EFFECTS = [
    effect("map_transform", x_mm=2.0, y_mm=-1.0, rotation_deg=1.0, scale=1.0),
    effect("crosstalk", k=0.1),
    effect("hysteresis", r_pa=[500.0, 8000.0], w=[0.02, 0.03]),
    effect("creep", a=[0.01, 0.02], tau_s=[2.0, 20.0]),
    effect("power_creep", a=0.03, exponent=0.2, t0_s=60.0),
    effect("lag", tau_s=0.015),
    effect("plates", ONE_BOARD, area_mm2=19.0, gap_mm=2.0, stiffness_n_per_m=9e3, permittivity=1.5, ff_per_count=0.96),
    effect("permittivity", gas_permittivity=1.0, solid_permittivity=2.5, solid_share=0.1, rest_count=300.0),
    effect("temperature", count_per_k=0.3, gain_per_k=0.003, t0_c=25.0),
    effect("compensation", skin_type=8, generation=4, count_per_k=0.3, t0_c=24.0),
    effect("bit_shift", ONE_BOARD, shift=2),
    effect("sample_and_hold", rate_hz=CDC_HZ),
    effect("jitter", std_s=0.001),
    effect("loss", ONE_BOARD, share=0.05, run=3.0),
    effect("delay", delay_s=0.02),
]


def digest(folder: Path) -> str:
    """Return the digest of all files, in the order of their names."""
    sha256 = hashlib.sha256()
    for path in sorted(folder.iterdir()):
        sha256.update(path.name.encode() + path.read_bytes())
    return sha256.hexdigest()


def main() -> None:
    config = Config(insoles=Config().insoles[:1])
    trial = Trial("t4", config, [LEFT], effects={"left": EFFECTS}, seed=7)
    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(digest(trial.write(Path(folder) / "t4", 5.0)))


if __name__ == "__main__":
    main()
