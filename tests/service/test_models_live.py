"""A daemon whose calibration has effects, between processes: what subscribers get, and the switch while it runs."""

from __future__ import annotations

import json

import insole_daemon
from insole_daemon.cli.model import _reply_lines
from insole_daemon.config import Config
from insole_daemon.physics.calibration import FORMAT
from insole_daemon.skin.layout import builtin

CONFIG = """\
format: insole-config/1
rig: test
insoles:
  - foot: left
    calibration: left.json
    boards: [{{address: 5, interface: can0}}, {{address: 6, interface: can0}}, {{address: 7, interface: can0}}]
zenoh:
  listen: [{endpoint}]
"""
EFFECTS = [
    {"effect": "viscoelasticity", "where": {"scope": "insole"},
     "parameters": {"a": {"value": 0.3, "unit": "1"}, "tau_s": {"value": 0.5, "unit": "s"}}},
    {"effect": "delay", "where": {"scope": "insole"}, "parameters": {"delay_s": {"value": 0.03, "unit": "s"}}},
]  # fmt: skip


def test_both_models_reach_a_subscriber_and_it_can_switch(daemon):
    daemon.end()
    daemon.config_file.write_text(CONFIG.format(endpoint=daemon.endpoint))
    layout = builtin("left", Config().insoles[0].addresses)
    taxels = [
        {"board": t.board, "triangle": t.triangle, "taxel": i, "baseline_count": 240, "coefficients_pa": [0, 8000]}
        for t in layout.triangles
        for i in range(12)
        if i not in (6, 10)
    ]
    document = {"format": FORMAT, "foot": "left", "taxels": taxels, "effects": EFFECTS}
    (daemon.config_file.parent / "left.json").write_text(json.dumps(document))
    daemon.start()
    with daemon.boards(), insole_daemon.connect(daemon.endpoint) as insole:
        raws, models, wrenches, events = (
            getattr(insole, name)("left") for name in ("raws", "models", "wrenches", "events")
        )
        first = next(models)
        reply = insole.request("left", "model", do="static")
        next(event for event in events if event.kind == "model_switched")
        both, read, received = {}, {}, []
        for wrench in wrenches:
            received.append(wrench)
            if sum(each.model == "static" for each in received) > 5:
                break
        for each in models:
            both[each.seq] = each
            if each.seq >= received[-1].seq:
                break
        for raw in raws:
            read[raw.seq] = raw
            if raw.seq >= received[-1].seq:
                break
        meta = insole.meta("left")
    assert first.model == "dynamic"
    assert (reply["model"], meta.model, reply["late_ms"]) == ("static", "static", 30.0)
    assert _reply_lines(reply)[2:] == ["  viscoelasticity, the whole insole", "  delay, the whole insole"]
    assert {each.model for each in received} == {"static", "dynamic"}
    compared = 0
    for wrench in received:
        if wrench.seq not in both or wrench.seq not in read:
            continue
        pair, raw = both[wrench.seq], read[wrench.seq]
        compared += 1
        assert wrench.model == pair.model
        assert (wrench.f_z_n, wrench.t_ns) == (
            (pair.static_f_z_n, raw.t_ns) if wrench.model == "static" else (pair.dynamic_f_z_n, raw.t_ns - 30_000_000)
        )
    assert compared > 5
