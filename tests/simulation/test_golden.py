"""The emulator's defaults give, byte for byte, what recordings and golden files were made from."""

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


# Taken before there were generations and faults. On another numpy or machine libm may differ in the last bit of
# a pressure, which a count hardly ever shows.
@pytest.mark.parametrize(
    ("emulator", "digest"),
    [
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS)), "cf29acbc3cc5ab4bb35336f94fe4320a"),
        (Emulator(settings(), LAYOUTS, Walk(LAYOUTS), seed=3), "12acffe2134d5ad33c2ee8a857c234a7"),
        (Emulator(settings(period_ms=8), LAYOUTS, Unloaded(LAYOUTS)), "6341bb6cc2c46767580539074b996778"),
        (
            Emulator(settings(skin_type=7), LAYOUTS[:1], Stand(LAYOUTS), left_out=[6]),
            "ae37d6569579f0f7f3ebf7cfac480630",
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
