"""Detection of hardware faults from the counts: triangles, taxels and boards of one foot."""

from .deferred import DeferredFaultWatch
from .watch import HEALED, KINDS, Change, Fault, FaultWatch, Kind

__all__ = ["HEALED", "KINDS", "Change", "DeferredFaultWatch", "Fault", "FaultWatch", "Kind"]
