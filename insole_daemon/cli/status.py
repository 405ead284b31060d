"""`insole status`: show what runs and every problem, on one screen."""

from __future__ import annotations

import sys
import threading
from typing import TYPE_CHECKING

from ..config import DEFAULT_ENDPOINT
from .options import Connect, RigName, ZenohFile, name_next
from .tables import fold

if TYPE_CHECKING:
    from ..wire.messages import Health, Meta

_HEALTH_WITHIN_S = 3.0  # health comes once a second
_INDENT = 15  # column of the values


def status(rig: RigName = "*", connect: Connect = DEFAULT_ENDPOINT, zenoh_config: ZenohFile = None) -> None:
    """Show what runs and every problem, on one screen."""
    from ..errors import WireError
    from ..wire.client import Client

    with Client(connect, rig, zenoh_config) as insole:
        feet = insole.feet()
        if not feet:
            suffix = "" if rig == "*" else f" of rig {rig}"
            raise WireError(f"a Zenoh node answers on {connect}, but no insole daemon{suffix} is behind it")
        healths = {(name, foot): insole.healths(foot, name) for name, foot in feet}

        def give_up() -> None:
            for messages in healths.values():
                messages.close()

        end = threading.Timer(_HEALTH_WITHIN_S, give_up)
        end.start()
        newest = {key: next(messages, None) for key, messages in healths.items()}
        end.cancel()
        wrong = False
        for name, foot in feet:
            health, meta = newest[name, foot], insole.meta(foot, name)
            sys.stdout.write(_screen(name, foot, health, meta))
            wrong |= health is None or bool(_problems(health, meta))
        sys.stdout.flush()
    name_next("insole doctor" if wrong else "insole record walk-1 --remote, or insole view --open")


def _screen(rig: str, foot: str, health: Health | None, meta: Meta) -> str:
    from ..skin.quality import WINDOW_S, Quality

    if health is None:
        return f"{rig} {foot}: no health within {_HEALTH_WITHIN_S:g} s: the daemon hangs; restart it\n"
    running = f"{health.publish_rate_hz:.1f} Hz, up {health.uptime_s:.0f} s, version {meta.version}"
    lines = [
        f"{rig} {foot}: {health.state}, {running}",
        f"  layout       {meta.layout}",
        f"  calibration  {meta.calibration}",
        f"  zero         {meta.zero_source}",
        f"  quality      {Quality.of(health.quality).sentence}, in the last {WINDOW_S} s",
        "  cycles       " + _format_counts({name: count for name, count in health.cycles.items() if count}),
        "  latency      " + ", ".join(f"{k} {v:.2f} ms" for k, v in health.latency_ms.items() if v is not None),
    ]
    bus = health.bus
    states = "".join(f"{name} {interface['state']}, " for name, interface in bus["interfaces"].items())
    lines.append(f"  bus          {states}{bus['frames']} frames, {bus['overflows']} lost to a full receive queue")
    for board in health.boards:
        age = "" if board["age_ms"] is None else f", age {board['age_ms']:.0f} ms"
        lines.append(
            f"  board {board['address']:<2}     {board['state']}: sends {board['rate_hz']:.1f} Hz, "
            f"new values {board['change_rate_hz']:.1f} Hz{age}, {board['missed']} missed"
        )
    lines += [f"  wrong        {problem}" for problem in _problems(health, meta)]
    return "\n".join(fold(line, _INDENT) for line in lines) + "\n"


def _problems(health: Health, meta: Meta) -> list[str]:
    """Return every problem with its remedy, causes before their consequences."""
    lost = {name: interface for name, interface in health.bus["interfaces"].items() if interface["state"] != "up"}
    wrong = [f"{name} is {interface['state']}: {interface['error']}" for name, interface in lost.items()]
    behind = {board["address"] for board in meta.boards if board["interface"] in lost}
    wrong += [
        f"board {board['address']} is {board['state']}: is it powered, connected and started?"
        for board in health.boards
        if board["state"] != "streaming" and board["address"] not in behind  # the state of those is unknown
    ]
    for fault in health.faults:
        if fault["kind"] != "board_silent":  # reported above
            where = " ".join(f"{of} {fault[of]}" for of in ("board", "triangle", "taxel") if fault[of] is not None)
            wrong.append(f"{where}: {fault['kind'].partition('_')[2].replace('_', ' ')}; its event has the details")
    if health.bus["overflows"]:
        wrong.append("the kernel dropped frames: raise net.core.rmem_max to 8388608, or give the daemon more CPU")
    if health.bus["clock_steps"]:
        wrong.append(
            f"frames went back in time {health.bus['clock_steps']} times: the system clock was set while the daemon "
            "ran, and t_ns with it; let chrony or systemd-timesyncd keep it, and wait until 'timedatectl' says "
            "synchronized before you measure"
        )
    if health.bus["error_frames"]:
        wrong.append(f"error frames: {_format_counts(health.bus['error_frames'])}: check wiring and termination")
    refused = {reason: count for reason, count in health.refused.items() if count and reason != "other"}
    for reason, count in refused.items():
        wrong.append(f"frames refused as {reason.replace('_', ' ')}: {count}")
    return wrong


def _format_counts(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items())
