"""The sealed truth of a case: what is concealed, where, how strong, and what is scored of it."""

from typing import Any

import numpy as np

from .case import Case
from .effect import Effect
from .faults import Fault
from .geometry import PRESSURE_TAXELS
from .plan import EQUIVALENT
from .signal_path import Signal


def _settled_share(case: Case, shape: dict[str, Any]) -> float:
    """Share of a drift that is reached at the end of the part that the tool gets."""
    if "settle_s" not in shape:
        return 1.0
    return 1 - float(np.exp(-(case.trial.main_s - shape["start_s"]) / shape["settle_s"]))


def parameters(case: Case, effect: Effect) -> dict[str, list[float]]:
    """The scored parameters by their names in formats.md: those that this generator's law has, too."""
    shape, amplitude, signed = effect.shape, effect.amplitude, effect.signed
    if effect.word == "rezero":
        t_s = amplitude * case.trial.main_s
        columns = np.flatnonzero(effect.place.ravel())
        around = Signal(case.trial, case.taxels_mm, case.sensors, case.effects, columns).mean(
            np.array([t_s - 1e-6, t_s])
        )
        return {"t_s": [t_s], "shift_count": [float((around[1] - around[0]).mean())]}
    if effect.word == "clock":
        if effect.law == "rows":
            return {"offset_s": [shape["offset_s"]], "rate": [shape["rate"]]}
        return {"offset_s": [amplitude]} if effect.law == "can_offset" else {"rate": [1e-6 * signed]}
    if effect.word == "map_transform":
        x_mm, y_mm = amplitude * np.cos(shape["way"]), amplitude * np.sin(shape["way"])
        return {"x_mm": [float(x_mm)], "y_mm": [float(y_mm)], "rotation_deg": [shape["rotation_deg"]]}
    values: dict[str, float] = {
        "snap": {
            "up_pa": shape.get("up_pa"),
            "down_pa": shape.get("down_pa"),
            "step_pa": amplitude * shape.get("span_pa", 0),
        },
        "viscoelasticity": {"a": amplitude, "tau_s": shape.get("tau_s")},
        "lag": {"tau_s": amplitude},
        "delay": {"delay_s": amplitude},
        "temperature": {"count_per_k": signed},
        "drift": {"shift_count": signed * _settled_share(case, shape)},
        "stiffening": {"knee_pa": shape.get("knee_pa")},
        "gain": {"gain": 1 + signed},
        "baseline": {"shift_count": signed},
        "preload": {"p0_pa": amplitude},
        "crosstalk": {"k": amplitude},
        "bit_shift": {"shift": case.sensors.shift + shape.get("step", 0)},
    }.get(effect.word, {})
    return {name: [float(value)] for name, value in values.items() if value is not None}


def _taxel_ids(case: Case, mask: np.ndarray) -> list[list[int]]:
    """[board, triangle, taxel] of the taxels in `mask` (28, 12)."""
    address, slot = case.geometry.address, case.geometry.slot
    return [[int(address[triangle]), int(slot[triangle]), int(taxel)] for triangle, taxel in np.argwhere(mask)]


def _effect_truth(case: Case, effect: Effect) -> dict[str, Any]:
    """The sealed entry of a concealed effect."""
    return {
        "effect": effect.word,
        "law": effect.law,
        "where": effect.where,
        "taxels": [] if effect.word == "clock" else _taxel_ids(case, effect.place),
        "k_floor": round(case.k[effect.word], 4),
        "accept": case.accept[effect.word],
        "parameters": parameters(case, effect),
        "amplitude_fraction": case.amplitude_fraction.get(effect.word),
        "shape": {name: value for name, value in effect.shape.items() if name != "departure"},
    }


def _fault_truth(case: Case, fault: Fault) -> dict[str, Any]:
    """The sealed entry of a concealed fault."""
    return {
        "effect": fault.word,
        "law": fault.shape.get("kind", fault.word),
        "where": fault.where,
        "taxels": _taxel_ids(case, fault.place),
        "k_floor": None,
        "accept": case.accept[fault.word],
        "parameters": {},
        "amplitude_fraction": None,
        "when_s": fault.when_s,
    }


def truth(case: Case) -> dict[str, Any]:
    """The sealed truth of a case, without the digests of its files."""
    is_pressure_taxel = np.zeros((28, 12), bool)
    is_pressure_taxel[:, PRESSURE_TAXELS] = True
    effects = [_effect_truth(case, effect) for effect in case.effects]
    effects += [_fault_truth(case, fault) for fault in case.faults]
    has_slow_converter = case.timing.conversion_s > 0
    simulation = case.simulation
    return {
        "kind": case.spec.kind,
        "recording": case.spec.recording,
        "against": case.spec.against,
        "k_asked": case.spec.k,
        "variant": case.spec.variant,
        "local": case.spec.local,
        "foot": case.geometry.foot,
        "taxels": _taxel_ids(case, is_pressure_taxel),
        "effects": effects,
        "equivalent": list(EQUIVALENT[case.spec.variant]) if case.spec.kind == "undecidable" else [],
        # Readings that are up to one conversion old look like these effects.
        "tolerated": ["lag", "delay", "clock", "frame_loss"] if has_slow_converter else [],
        "protocol": case.trial.protocol,
        "span_pa": case.trial.span_pa,
        "main_s": case.trial.main_s,
        "clock": {"declared": case.clock.declared, "offset_s": case.clock.offset_s, "rate": case.clock.rate},
        "period_ms": list(case.timing.period_ms),
        "conversion_s": case.timing.conversion_s,
        "rows": case.rows,
        "memory_in_calibration": case.memory_in_calibration,
        "simulation": None
        if simulation is None
        else {"level": simulation.level, "begin_s": simulation.begin_s, "end_s": simulation.end_s},
    }
