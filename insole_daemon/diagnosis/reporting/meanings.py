"""The meaning of each effect's word, for the first page."""

from __future__ import annotations

from collections.abc import Mapping

from ..finding import LEFT_OUT

MEANINGS: Mapping[str, str] = {
    "hysteresis": "under the same load it reads more while unloading than while loading, at any speed",
    "snap": "the reading jumps at one load, and jumps back only at a lower one",
    "viscoelasticity": "a part of the response comes late, with one time constant",
    "creep": "under a constant load the reading goes on growing for minutes, and takes as long to come back",
    "lag": "the whole response follows the load with one time constant",
    "delay": "the whole response comes later, unchanged",
    "temperature": "warmth alone changes the reading",
    "drift": "the reading wanders slowly in time, whatever the load and the temperature",
    "rezero": "a board took a new zero in the middle of the recording",
    "gain": "it reads more or less than its calibration says, by one factor",
    "preload": "the strap or the shoe presses on it all the time, and the reference does not feel that",
    "baseline": "without load it rests at another count than when it was calibrated",
    "bit_shift": "the board divides its readings by another power of two than configured",
    "stiffening": "beyond some load it responds less and less, as a sole that is fully compressed",
    "swapped_triangles": "two triangles report under each other's name: the map, or the wiring, confuses them",
    "map_transform": "the insole does not lie where its map says: it is turned, shifted or of another size",
    "crosstalk": "the cover spreads a load: a taxel feels some of what lies on its neighbours",
    "clock": "the clock of the reference runs faster or slower than that of the insole",
    "dead_taxels": "taxels that do not respond",
    "open_triangle": "a triangle that has lost contact",
    "noise_burst": "a time in which readings are far noisier than usual",
    "frame_loss": "readings that did not arrive, or arrived again unchanged",
    "reference_fault": "the reference itself has readings that are impossible",
    "unknown": "a mismatch that none of the known effects explains",
}

FAULTS = (*LEFT_OUT, "reference_fault")  # of readings, not physics
