"""Every fault as it appears in the frames; the fingerprints are those of the protocol's facts, section 2."""

import numpy as np
import pytest

from insole_daemon import config
from insole_daemon.bus.frames import FrameBatch
from insole_daemon.errors import SimulationError
from insole_daemon.physics.sampling import CDC_HZ
from insole_daemon.simulation.emulator import Emulator
from insole_daemon.simulation.faults import KINDS, InjectedFault
from insole_daemon.simulation.foot import Stand, Walk
from insole_daemon.simulation.load import Unloaded
from insole_daemon.simulation.random_faults import random_fault
from insole_daemon.simulation.reference_insole import reference_insole
from insole_daemon.skin import layout

ADDRESSES = {"left": (5, 6, 7), "right": (8, 9, 10)}
LAYOUTS = [layout.builtin(foot, addresses) for foot, addresses in ADDRESSES.items()]
REST, STAND, WALK = Unloaded(LAYOUTS), Stand(LAYOUTS), Walk(LAYOUTS)
START_NS = 1_700_000_000_000_000_000
SECOND = 1_000_000_000
ON_THE_BUS_S = 0.02  # the most that a frame waits for others after its tick
ALL = list(range(12))


def emulator(load=REST, faults=(), generation="mtb4", period_ms=50, skin_type=0, **more):
    settings = config.Config(
        insoles=tuple(
            config.Insole(
                foot=foot,
                boards=tuple(
                    config.Board(address=a, interface="can0", period_ms=period_ms, skin_type=skin_type)
                    for a in addresses
                ),
            )
            for foot, addresses in ADDRESSES.items()
        )
    )
    return Emulator(settings, LAYOUTS, load, faults=faults, generation=generation, **more)


def triangle_of(batch, board=5, triangle=0, cls=4):
    """Return end times (n,) in s, counts (n, 12) and status words (n,) of a triangle."""
    mine = batch[batch.can_id == cls << 8 | board << 4 | triangle]
    half_a, half_b = (mine[mine.data[:, 0] == tag] for tag in (0x40, 0xC0))
    n = min(len(half_a), len(half_b))
    counts = np.concatenate([half_a.data[:n, 1:8], half_b.data[:n, 1:6]], axis=1).astype(int)
    status = half_b.data[:n, 6].astype(int) << 8 | half_b.data[:n, 7]
    return (half_b.t_ns[:n] - START_NS) * 1e-9, counts, status


def seen(seconds=2.0, board=5, triangle=0, **given):
    return triangle_of(emulator(**given).frames(START_NS, seconds), board, triangle)


# ---- fingerprints


@pytest.mark.parametrize("skin_type", [0, 1, 2, 8])
def test_a_loose_triangle_of_an_mtb4_is_flagged(skin_type):
    t_s, counts, status = seen(faults=[InjectedFault("loose", 1.0, 1.5, 5, 0)], skin_type=skin_type)
    loose = (t_s > 1 + ON_THE_BUS_S) & (t_s < 1.5)
    whole = (t_s < 1) | (t_s > 1.5 + ON_THE_BUS_S)
    expected = [255 if skin_type == 0 and taxel == 9 else 0 for taxel in ALL]
    assert (counts[loose] == expected).all()
    assert (status[loose] & 0xF == 2).all()
    assert not (status[whole]).any()
    assert (abs(counts[whole] - 240) < 10).all()


@pytest.mark.parametrize("skin_type", [0, 1, 2])
def test_a_loose_triangle_of_an_mtb3_reads_full_scale(skin_type):
    for seed in range(3):
        faults = [InjectedFault("loose", 1.0, None, 5, 0)]
        given = {"skin_type": skin_type, "generation": "mtb3", "seed": seed}
        run = emulator(faults=faults, **given).run(START_NS)
        baseline = run._mounted[0].board._baseline[0]
        t_s, counts, status = triangle_of(run.advance(START_NS + 2 * SECOND))
        # 16 bits wrap at 0x8000; the compensation, where there is one, moves that by at most 2047 codes.
        slack = 2048 if skin_type == 0 else 0
        loose = t_s > 1 + ON_THE_BUS_S
        assert (counts[loose][:, baseline < 0x8000 - slack] == 255).all()
        assert (counts[loose][:, baseline > 0x8000] == 0).all()
        assert np.isin(counts[loose], [0, 255]).all()
        assert (status[loose] & 0xF == 2).all()


@pytest.mark.parametrize("generation", ["mtb3", "mtb4"])
@pytest.mark.parametrize("skin_type", [0, 1, 2, 8])
def test_a_triangle_open_at_zeroing_reads_as_unloaded(generation, skin_type):
    run = emulator(generation=generation, skin_type=skin_type, streaming=False).run(START_NS)
    run.obey(commands((0x205, [0x4D, skin_type, 50, 240]), (0x205, [0x50, 0, 15, 3, 1, 0, 0x22])))
    run.advance(run.now_ns + SECOND)
    run.obey(commands((0x205, [0x07, 0])))
    _, counts, status = triangle_of(run.advance(run.now_ns + SECOND), 5, 2)  # no sensor there
    assert len(counts) > 15
    assert (counts == 240).all()
    assert (status == 2).all()


@pytest.mark.parametrize("generation", ["mtb3", "mtb4"])
@pytest.mark.parametrize("skin_type", [0, 1, 2, 8])
def test_a_dead_chip_is_zeroed_by_the_firmware_after_five_errors(generation, skin_type):
    given = {"load": STAND, "skin_type": skin_type, "generation": generation}
    t_s, counts, status = seen(faults=[InjectedFault("dead_chip", 1.0, None, 5, 0)], seconds=3, **given)
    dead = np.flatnonzero(status & 0xF == 1)[0] + np.arange((status & 0xF == 1).sum() + 10)
    assert 1 < t_s[dead[0]] < 1.05 + ON_THE_BUS_S
    first, after = dead[:5], dead[5:]  # five errors
    if generation == "mtb4":
        expected = [0 if skin_type == 0 and taxel == 9 else 255 for taxel in ALL]
        assert (counts[first] == expected).all()
    assert (status[first] & 0xF == 1).all()
    assert (counts[after] == 240).all()  # 0 is its baseline now: nothing to see any more
    assert not status[after].any()
    ticks_missing = round((t_s[after[0]] - t_s[first[-1]]) / 0.05) - 1
    assert ticks_missing == (3 if generation == "mtb3" else 0)
    # And the whole board was zeroed under the load.
    _, others, _ = seen(faults=[InjectedFault("dead_chip", 1.0, None, 5, 0)], seconds=3, triangle=1, **given)
    assert abs(others[after[0] :].mean(axis=0) - 240).max() < 6


def test_without_status_bits_only_counts_change():
    faults = [InjectedFault("loose", 1.0, None, 5, 0)]
    with_bits, without = (emulator(faults=faults, status_bits=b).frames(START_NS, 2) for b in (True, False))
    half_b = without.data[:, 0] == 0xC0
    assert not without.data[half_b, 6:].any()
    assert with_bits.data[half_b, 6:].any()
    assert (with_bits.data[:, :6] == without.data[:, :6]).all()


# ---- lines and taxels


def test_a_contact_may_be_loose_under_pressure_only():
    _, _, status = seen(load=WALK, faults=[InjectedFault("loose", 0.0, None, 5, 0, level_pa=20e3)], seconds=6)
    _, healthy, _ = seen(load=WALK, faults=[InjectedFault("loose", 99.0, None, 5, 0)], seconds=6)
    loose = status & 0xF == 2
    mean_pa = (240.4 - healthy[:, [0, 1, 2, 3, 4, 5, 7, 8, 9, 11]].mean(axis=1)) * 8000
    assert 0.05 < loose.mean() < 0.6
    assert mean_pa[loose].min() > 15e3
    assert mean_pa[~loose].max() < 25e3


def test_a_contact_may_be_loose_intermittently():
    status = seen(faults=[InjectedFault("loose", 0.0, None, 5, 0, chance=0.1)], seconds=20)[2]
    assert (status & 0xF == 2).mean() == pytest.approx(0.1, abs=0.05)


def test_dead_and_stuck_taxels_are_constant():
    faults = [InjectedFault("dead", 1.0, None, 5, 0, 4), InjectedFault("stuck", 1.0, None, 5, 0, 8, level_pa=400e3)]
    t_s, counts, _ = seen(load=WALK, faults=faults, skin_type=2, seconds=5)
    bad = t_s > 1.01
    assert set(counts[bad, 4]) == {240}
    assert len(set(counts[bad, 8])) == 1
    assert counts[bad, 8][0] == pytest.approx(240 - 50, rel=0.1)
    assert len(set(counts[bad, 5])) > 5
    assert len(set(counts[~bad, 4])) > 1


def test_a_taxel_saturates_always_or_above_a_level():
    faults = [
        InjectedFault("saturated", 1.0, None, 5, 0, 2),
        InjectedFault("saturated", 0.0, None, 5, 0, 3, level_pa=30e3),
    ]
    t_s, counts, status = seen(load=WALK, faults=faults, seconds=6)
    _, healthy, _ = seen(load=WALK, faults=[InjectedFault("dead", 99.0, None, 5)], seconds=6)
    bad = t_s > 1.01
    assert (counts[bad, 2] == 0).all()
    assert (status[bad] >> 6 & 1).all()  # far out of range
    zero = counts[:, 3] == 0
    assert 0.02 < zero.mean() < 0.9
    assert healthy[zero, 3].max() < 240
    assert healthy[~zero, 3].min() > 225


def test_noise_is_multiplied_by_the_factor():
    t_s, counts, _ = seen(faults=[InjectedFault("noisy", 5.0, None, 5, 0, 4, factor=10.0)], skin_type=2, seconds=15)
    others = np.delete(counts, [4, 6, 10], axis=1)
    assert others.std(axis=0).mean() == pytest.approx(1.04, abs=0.06), "a count, and the rounding to counts"
    assert counts[t_s < 5, 4].std() == pytest.approx(1.04, abs=0.3)
    assert counts[t_s > 5 + ON_THE_BUS_S, 4].std() == pytest.approx(9, rel=0.2)


# ---- boards


def test_rezero_under_load_makes_the_load_read_zero():
    for generation, missing in (("mtb4", 0), ("mtb3", 3)):
        faults = [InjectedFault("rezero", 1.0, None, 5)]
        t_s, counts, _ = seen(load=STAND, faults=faults, generation=generation, triangle=9, seconds=3)
        before, after = t_s < 1.0, t_s > 1.01
        assert abs(counts[after].mean(axis=0) - 240).max() < 6
        assert np.diff(t_s).max() == pytest.approx(0.05 * (missing + 1), abs=0.003)
        assert counts[before].mean() <= counts[after].mean() + 1
    pressed = STAND.pressure_pa("left", np.array([1.0]))[0]
    hardest = np.unravel_index(pressed.argmax(), pressed.shape)[0]
    board, triangle = (int(x) for x in LAYOUTS[0].identities[hardest])
    t_s, counts, _ = seen(
        load=STAND, faults=[InjectedFault("rezero", 1.0, None, board)], board=board, triangle=triangle
    )
    assert counts[t_s < 1.0].mean() < 235
    assert counts[t_s > 1.06].mean() > 238


def test_a_silent_board_ignores_commands_and_returns_in_phase():
    run = emulator(faults=[InjectedFault("silent", 1.0, 2.0, 5)]).run(START_NS)
    frames = [run.advance(START_NS + 1_500_000_000)]
    run.obey(commands((0x205, [0x07, 1]), (0x70F, [0xFF])))
    frames.append(run.advance(START_NS + 3 * SECOND))
    batch = FrameBatch.concatenate(frames)
    t_s = triangle_of(batch)[0]
    assert not ((t_s > 1 + ON_THE_BUS_S) & (t_s < 2.0)).any()
    assert np.allclose(np.diff(t_s) / 0.05, np.round(np.diff(t_s) / 0.05), atol=0.1)
    assert t_s[-1] > 2.9
    assert 0x750 not in batch.can_id
    assert 0x760 in batch.can_id


@pytest.mark.parametrize("generation", ["mtb3", "mtb4"])
def test_a_reset_board_recovers_in_three_ways(generation):
    def after(comes_back):
        fault = InjectedFault("reset", 1.0, 1.5, 5, comes_back=comes_back)
        batch = emulator(load=STAND, generation=generation, faults=[fault]).frames(START_NS, 3)
        t_s = triangle_of(batch)[0]
        assert not ((t_s > 1 + ON_THE_BUS_S) & (t_s < 1.5)).any()
        return triangle_of(batch[batch.t_ns > START_NS + 1_500_000_000])

    assert not len(after("silent")[0])
    t_s, counts, _ = after("defaults")
    assert len(t_s) == pytest.approx(29, abs=1)
    assert abs(counts.mean(axis=0) - 245).max() < 8  # other settings, and a new baseline
    t_s, counts, _ = after("configured")
    assert abs(counts.mean(axis=0) - 240).max() < 6


def test_a_reset_board_obeys_commands():
    for generation in ("mtb3", "mtb4"):
        run = emulator(generation=generation, faults=[InjectedFault("reset", 1.0, None, 5)]).run(START_NS)
        run.advance(START_NS + 2 * SECOND)
        run.obey(commands((0x205, [0x07, 0])))
        _, counts, _ = triangle_of(run.advance(START_NS + 3 * SECOND))
        assert abs(counts.mean() - 245) < 4


def test_an_address_clash_doubles_one_address_and_hides_another():
    batch = emulator(faults=[InjectedFault("address_clash", 1.0, 2.0, 5, other=8)]).frames(START_NS, 3)
    clash = (batch.t_ns > START_NS + 1_010_000_000) & (batch.t_ns <= START_NS + 2 * SECOND)
    boards = batch.can_id >> 4 & 0xF
    assert not (boards[clash] == 8).any()
    assert (boards[~clash] == 8).any()
    assert (batch.can_id[clash] == 0x450).sum() == pytest.approx(80, abs=4)  # 2 boards · 20 Hz · A and B
    run = emulator(faults=[InjectedFault("address_clash", 0.0, None, 5, other=8)]).run(START_NS)
    run.advance(START_NS + SECOND)
    run.obey(commands((0x70F, [0xFF])))
    answers = run.advance(START_NS + 2 * SECOND)
    assert (answers.can_id == 0x750).sum() == 2


# ---- all of them


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_does_not_affect_other_boards(kind):
    draw = np.random.default_rng(KINDS.index(kind))
    faults = random_fault(kind, draw, LAYOUTS, 0.5, 2.0)
    struck = {fault.board for fault in faults} | {fault.other for fault in faults}
    healthy, faulty = (emulator(load=WALK, faults=f).frames(START_NS, 3) for f in ((), faults))
    assert healthy.data.tobytes() + healthy.can_id.tobytes() != faulty.data.tobytes() + faulty.can_id.tobytes()
    for board in {5, 6, 7, 8, 9, 10} - struck:
        one, two = (b[b.can_id >> np.uint32(4) == 0x40 | board] for b in (healthy, faulty))
        n = min(len(one), len(two))  # the end may cut a tick in two, elsewhere on a bus with less on it
        assert n > 0.97 * len(one)
        assert one.can_id[:n].tobytes() == two.can_id[:n].tobytes()
        assert one.data[:n].tobytes() == two.data[:n].tobytes()


@pytest.mark.parametrize("generation", ["mtb3", "mtb4"])
def test_frames_with_faults_do_not_depend_on_the_step_size(generation):
    def faults():
        draw = np.random.default_rng(3)
        return [f for kind in KINDS for f in random_fault(kind, draw, LAYOUTS, 0.2, 1.5)]

    assert faults() == faults()
    given = {"load": WALK, "generation": generation, "faults": faults(), "cdc_hz": CDC_HZ, "period_ms": 20}
    whole = emulator(**given).run(START_NS).advance(START_NS + 2 * SECOND)
    run = emulator(**given).run(START_NS)
    parts = FrameBatch.concatenate([run.advance(START_NS + step * 13_000_000) for step in range(1, 154)])
    n = len(parts)
    assert n > 0.95 * len(whole)
    for name in FrameBatch.__slots__:
        assert getattr(parts, name).tobytes() == getattr(whole, name)[:n].tobytes()


@pytest.mark.parametrize("kind", KINDS)
def test_random_faults_have_valid_places_and_times(kind):
    draw = np.random.default_rng(1)
    identities = {tuple(row) for one in LAYOUTS for row in one.identities.tolist()}
    cases = [random_fault(kind, draw, LAYOUTS, 10.0, 20.0) for _ in range(100)]
    for fault in (fault for case in cases for fault in case):
        assert fault.kind == kind
        assert 10.0 <= fault.t_s <= 20.0
        assert fault.until_s is None or fault.t_s < fault.until_s <= 30.0
        assert fault.triangle is None or (fault.board, fault.triangle) in identities
        assert fault.taxel not in (6, 10)
    assert len({case[0].t_s for case in cases}) == 100


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("melted", 0.0, None, 5), "expected one of loose"),
        (("loose", 2.0, 1.0, 5), "expected until_s after t_s 2.0, found 1.0"),
        (("silent", 0.0, None, 5, 3), "found 3"),
        (("loose", 0.0, None, 5, 3, 4), "found 4"),
        (("rezero", 0.0, 1.0, 5), "a moment"),
        (("address_clash", 0.0, None, 5), "another board"),
        (("loose", 0.0, None, 5, 3, None, None, 8.0, 0.0), "found 0.0"),
    ],
)
def test_an_invalid_fault_is_refused(given, message):
    with pytest.raises(SimulationError, match=message):
        InjectedFault(*given)


def test_a_fault_of_a_missing_board_is_refused():
    with pytest.raises(SimulationError, match=r"faults\[0\]\.board: .*\[5, 6, 7, 8, 9, 10\], found 3"):
        emulator(faults=[InjectedFault("silent", 0.0, None, 3)])
    with pytest.raises(SimulationError, match=r"faults\[1\]\.triangle: .* of board 6, .*, found 2"):
        emulator(faults=[InjectedFault("silent", 0.0, None, 6), InjectedFault("loose", 0.0, None, 6, 2)])


def test_an_address_clash_needs_two_boards():
    rear = [row for row, triangle in enumerate(LAYOUTS[0].triangles) if triangle.board == 7]
    alone = layout.assigned(LAYOUTS[0], tuple(LAYOUTS[0].triangles[row] for row in rear))
    with pytest.raises(SimulationError, match="at least two boards, found board 7 alone"):
        random_fault("address_clash", np.random.default_rng(0), [alone], 0.0, 10.0)


# ---- converters, temperature


@pytest.mark.parametrize(("period_ms", "rate_hz"), [(20, CDC_HZ), (50, 20.0)])
def test_no_triangle_changes_faster_than_its_converter(period_ms, rate_hz):
    _, counts, _ = seen(load=WALK, period_ms=period_ms, cdc_hz=CDC_HZ, seconds=20)
    changes = (np.diff(counts, axis=0) != 0).any(axis=1).sum() / 20
    assert changes == pytest.approx(rate_hz, rel=0.04)
    without = (np.diff(seen(load=WALK, period_ms=20, seconds=20)[1], axis=0) != 0).any(axis=1).sum() / 20
    assert without > 48


def test_converters_delay_by_up_to_a_sequence():
    _, now, _ = seen(load=WALK, period_ms=20, board=5, triangle=8, seconds=20, skin_type=2)
    _, held, _ = seen(load=WALK, period_ms=20, board=5, triangle=8, seconds=20, skin_type=2, cdc_hz=CDC_HZ)
    now, held = (c[:, :6].mean(axis=1) - c[:, :6].mean() for c in (now, held))
    lags = [np.dot(now[: len(now) - 5], held[lag : len(held) - 5 + lag]) for lag in range(5)]
    assert np.argmax(lags) == 1  # 18 ms on average


def test_pads_follow_temperature_and_type_0_compensates_taxels():
    warm = 10.0

    def temperature_c(t_s):
        return 25.0 + warm * np.clip(t_s - 1.0, 0.0, 1.0)

    for skin_type, left in ((0, 0.03), (2, 1.0)):
        t_s, counts, _ = seen(skin_type=skin_type, temperature_c=temperature_c, seconds=20)
        change = counts[t_s < 1].mean(axis=0) - counts[t_s > 2].mean(axis=0)
        assert change[[6, 10]] == pytest.approx(reference_insole().pad_count_per_k * warm, abs=1)
        assert change[9] == pytest.approx(left * reference_insole().pad_count_per_k * warm * 164 / 128, abs=1)


def test_an_mtb4_sends_its_temperature():
    run = emulator(generation={5: "mtb3"}, temperature_c=lambda t_s: 30.0 - 40.0 * (t_s > 2.5)).run(START_NS)
    run.obey(commands(*((0x200 | a, p) for a in (5, 6) for p in ([0x39, 1], [0x3A, 1]))))
    batch = run.advance(START_NS + 4_500_000_000)
    temperature_frames = batch[(batch.can_id & 0x70F) == 0x30E]
    assert set(temperature_frames.can_id.tolist()) == {0x36E}
    assert (temperature_frames.dlc == 5).all()
    assert [row.tobytes()[:5].hex() for row in temperature_frames.data] == ["012c010000"] * 2 + ["019cff0000"] * 2
    run.obey(commands((0x206, [0x3A, 0])))
    batch = run.advance(START_NS + 8 * SECOND)
    assert 0x36E not in batch.can_id


def commands(*frames):
    n = len(frames)
    data = np.zeros((n, 8), np.uint8)
    for row, (_, payload) in enumerate(frames):
        data[row, : len(payload)] = payload
    ids = np.array([can_id for can_id, _ in frames], np.uint32)
    dlc = np.array([len(payload) for _, payload in frames], np.uint8)
    times, nothing = np.zeros(n, np.int64), np.zeros(n, np.uint8)
    return FrameBatch(times, times, nothing, ids, dlc, data, nothing)
