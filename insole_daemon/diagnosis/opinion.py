"""What recordings say of an effect that others have shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Opinion:
    """Of one effect, by recordings that were not asked when it was found."""

    shown_by: tuple[str, ...]  # told better with it
    contradicted_by: tuple[str, ...]  # told better without; the others do not care
    rms: tuple[float, float]  # what is left without it and with it: N of walks, counts of a chamber
