"""Faults of the hardware, found in the counts: triangles, taxels and boards of one foot."""

from .watch import BoardState, Fault, FaultEvent, FaultWatch, Kind, TaxelState, TriangleState

__all__ = ["BoardState", "Fault", "FaultEvent", "FaultWatch", "Kind", "TaxelState", "TriangleState"]
