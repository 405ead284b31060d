"""The emulator's defaults give the same bytes on every machine."""

import hashlib

import pytest

from insole_daemon import config
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.skin import layout

ADDRESSES = {"left": (5, 6, 7), "right": (8, 9, 10)}
LAYOUTS = [layout.builtin(foot, addresses) for foot, addresses in ADDRESSES.items()]
START_NS = 1_700_000_000_000_000_000


def settings(**board):
    return config.Config(
        insoles=tuple(
            config.Insole(
                foot=foot,
                boards=tuple(config.Board(address=a, interface="can0", **board) for a in addresses),
            )
            for foot, addresses in ADDRESSES.items()
        )
    )


# With the constants of insole-reference.yaml: who changes one changes these.
@pytest.mark.parametrize(
    ("emulator", "digest"),
    [
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS)), "4ab6f8ccbd8a1533c273e95c5950531a"),
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS), seed=3), "df19b2e34e6d0cc08aaba53d0efdc103"),
        (Emulator(settings(period_ms=8), LAYOUTS, Unloaded(LAYOUTS)), "17038ce487c5ea63675cc6e823d41fec"),
        (
            Emulator(settings(skin_type=7), LAYOUTS[:1], Stand(LAYOUTS), left_out=[6]),
            "37b5fcfa424a0f488b72617fa21910d4",
        ),
    ],
    ids=["walk", "seed", "busy", "raw"],
)
def test_defaults_are_what_they_were(emulator, digest):
    batch = emulator.frames(START_NS, 2)
    found = hashlib.sha256()
    for name in FrameBatch.__slots__:
        found.update(getattr(batch, name).tobytes())
    assert found.hexdigest()[:32] == digest
