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
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS)), "e4a89b9f1deeb43448f9ea2602c982f6"),
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS), seed=3), "dec071d7ca6a0d1c4e95269b54f2d461"),
        (Emulator(settings(period_ms=8), LAYOUTS, Unloaded(LAYOUTS)), "17038ce487c5ea63675cc6e823d41fec"),
        (
            Emulator(settings(skin_type=7), LAYOUTS[:1], Stand(LAYOUTS), left_out=[6]),
            "0638bcea0882bca46512cc266a5615cf",
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
