"""The section "What to do now": a remedy per finding, with the commands for this foot and these recordings."""

from __future__ import annotations

from collections.abc import Mapping

from ..result import Diagnosis

# By word; {foot} is the foot, {recordings} the folders that were diagnosed.
REMEDIES: Mapping[str, str] = {
    "gain": "Calibrate again: insole calibrate {recordings} --out calibration.json",
    "baseline": "Take the zero with the foot in the air: insole zero --foot {foot}",
    "stiffening": "Calibrate up to the highest load that is worn: insole calibrate {recordings} --out calibration.json",
    "preload": "Loosen the strap, or take the zero with the shoe on and the foot in the air: insole zero --foot {foot}",
    "bit_shift": "Set the board's shift in config.yaml to the one that was found, then: insole boards configure",
    "rezero": "Record again, and start or configure boards only while the foot is in the air.",
    "swapped_triangles": "Press the triangles one after another to see which is which: insole map",
    "map_transform": "Press the triangles one after another to see where each lies: insole map",
    "drift": "Let the insole settle for some minutes, and take the zero before every trial: insole zero --foot {foot}",
    "temperature": "Let the insole warm up in the shoe, and take the zero then: insole zero --foot {foot}",
    "clock": "Synchronise the clock of the reference, or record a trigger or LSL markers beside it.",
    "reference_fault": "Look at the reference instrument: its zero, its cable, its range; then record again.",
    "dead_taxels": "Look at the patch and its connector: insole doctor",
    "open_triangle": "Look at the triangle's connector: insole doctor",
    "noise_burst": "Look for a loose cable, or for a motor or a charger beside it, and record again.",
    "frame_loss": "Look at the bus, its cable and its load: insole doctor",
    "unknown": "Record what is said below under 'cannot tell', and diagnose all together; send us page and recordings.",
}
MODELLED = "The model beside this page undoes {words}. Try it on a recording that had no part in it: "
VERIFY = "insole validate OTHER-RECORDING --calibration model.json"
THEN = "; then name it as the insole's calibration in config.yaml, and the daemon undoes it live."


def what_now(diagnosis: Diagnosis) -> list[str]:
    """Return sentences, each with its command; empty if there is no finding."""
    words = list(dict.fromkeys(finding.effect for finding in diagnosis.findings))
    names = {
        "foot": diagnosis.results[0].seen.layout.foot, "recordings": " ".join(diagnosis.recordings),
    }  # fmt: skip
    modelled_words = list(dict.fromkeys(effect.law.word for effect in diagnosis.effects))
    modelled_first = [MODELLED.format(words=" and ".join(modelled_words)) + VERIFY + THEN] if modelled_words else []
    return modelled_first + [
        f"{word.replace('_', ' ')}: {REMEDIES[word].format(**names)}" for word in words if word in REMEDIES
    ]
