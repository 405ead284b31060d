"""What became of a run, as a row of the table."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.faults.matrix import seen as seens
from benchmarks.faults.matrix.rig import Rig
from insole_daemon.wire.messages import Health

MARGIN_NS = 100_000_000  # a fault of the boards begins with the tick nearest to the moment


@dataclass(frozen=True)
class Verdict:
    """One row."""

    group: str
    fault: str
    bar_s: float
    saw: str
    back_s: float | None  # at 50 Hz with fresh readings of every board, after the fault's end; None: never
    believed_s: float | None  # … and as much of it valid as before
    lost_in: int  # ticks of a board that were on the bus and never published: from the fault to full rate
    lost_out: int  # before and after
    cycles: int  # got before and after
    note: str

    @property
    def met(self) -> bool:
        return self.lost_out == 0 and self.back_s is not None and self.back_s <= self.bar_s

    def document(self) -> dict[str, object]:
        return asdict(self)


def judge(rig: Rig, group: str, fault: str, bar_s: float, note: str, fault_is_over: bool) -> Verdict:
    """Read what the processes of `rig` wrote. `fault_is_over`: else values are not expected to be valid again."""
    seen = seens.load(rig.folder / "seen", rig.folder / "sent.npz", rig.layouts)
    backs, believeds, sentences = [], [], []
    lost_in = lost_out = cycles = 0
    for name, foot in seen.feet.items():
        end_ns = int(foot.got_ns[-1])
        fresh = foot.fresh().all(axis=1)
        valid = foot.valid()
        before = (foot.got_ns < rig.began_ns) & (foot.got_ns > rig.began_ns - 2_000_000_000)
        usual = float(np.median(valid[before]))
        back = seens.back_s(foot, rig.ended_ns, fresh, end_ns)
        believed = seens.back_s(foot, rig.ended_ns, fresh & (valid >= 0.99 * usual), end_ns)
        backs.append(back)
        believeds.append(believed)
        until_ns = end_ns if back is None else rig.ended_ns + round(back * 1e9)
        lost = foot.lost_ns()
        first_ns = int(foot.got_ns[0]) + 1_000_000_000
        lost = lost[(lost > first_ns) & (lost < end_ns - 300_000_000)]
        inside = (lost > rig.began_ns - MARGIN_NS) & (lost < until_ns)
        lost_in += int(inside.sum())
        lost_out += int((~inside).sum())
        during = (foot.got_ns >= rig.began_ns) & (foot.got_ns < rig.ended_ns)
        cycles += int((~during).sum())
        sentences.append(f"{name} {_during(foot, rig, during, valid, fresh, usual)}")
    if len(sentences) == 1:
        sentences = [sentences[0].partition(" ")[2]]
    elif sentences[0].partition(" ")[2] == sentences[1].partition(" ")[2]:
        sentences = [sentences[0].replace("left", "both feet", 1)]
    kinds = seens.kinds(seen.events, rig.began_ns - MARGIN_NS, rig.ended_ns + 4_000_000_000)
    counted = _counted(seen, rig)
    saw = "; ".join(sentences) + (f". Events: {kinds}" if kinds else "") + (f". `health`: {counted}" if counted else "")
    back = None if None in backs else max(backs)
    believed = None if None in believeds or not fault_is_over else max(believeds)
    return Verdict(group, fault, bar_s, saw, back, believed, lost_in, lost_out, cycles, note)


def _during(foot: seens.Foot, rig: Rig, during, valid, fresh, usual: float) -> str:
    took_s = (rig.ended_ns - rig.began_ns) * 1e-9
    if not during.any():
        return f"nothing for {took_s:.1f} s"
    got_ns = np.concatenate([[rig.began_ns], foot.got_ns[during], [rig.ended_ns]])
    repeated = np.mean([foot.raws[at].repeated for at in np.flatnonzero(during)])
    share = valid[during].min() / usual
    words = [f"{during.sum() / took_s:.0f} Hz"]
    if repeated > 0.02:
        words.append(f"{100 * repeated:.0f} % repeats")
    if share < 0.99:
        words.append(f"{100 * share:.0f} % of it valid at the least")
    longest_s = np.diff(got_ns).max() * 1e-9
    if longest_s > 0.15:
        words.append(f"longest pause {longest_s:.2f} s")
    return ", ".join(words)


def _counted(seen: seens.Seen, rig: Rig) -> str:
    """What counters moved between the last health before the fault and the last of all, of both feet."""
    words = []
    for foot in seen.feet:
        healths = [(t_ns, h) for t_ns, h in seen.healths if h.foot == foot]
        before = [h for t_ns, h in healths if t_ns < rig.began_ns]
        if not before or len(healths) < 2:
            continue
        old, new = _flat(before[-1]), _flat(healths[-1][1])
        moved = {k: n - old.get(k, 0) for k, n in new.items() if n != old.get(k, 0)}
        words.append(", ".join(f"`{k}` +{n}" for k, n in moved.items() if n > 0))
    return (
        words[0]
        if len(set(words)) == 1
        else "; ".join(f"{foot} {w}" for foot, w in zip(seen.feet, words, strict=False) if w)
    )


def _flat(health: Health) -> dict[str, int]:
    """The counters that stand still while all is well."""
    bus = health.bus
    counts = {name: n for name, n in health.cycles.items() if name in ("repeated", "skipped", "extrapolated")}
    counts |= {name: bus[name] for name in ("overflows", "clock_steps")} | health.asked
    counts |= {f"error_frames.{kind}": n for kind, n in bus["error_frames"].items()}
    counts |= {f"{name}.reopened": state["reopened"] for name, state in bus["interfaces"].items()}
    for reason, n in health.refused.items():
        of = n if isinstance(n, dict) else {"": n}
        counts |= {f"refused.{reason}.{key}".rstrip("."): m for key, m in of.items()}
    return counts
