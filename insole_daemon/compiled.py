"""The compiled kernel, if this installation has one.

`kernel.c` has the most expensive loops of a cycle; its results equal those of the numpy code next to each call, to the
bit. It is built with the package if there is a C compiler with Python's headers; otherwise `kernel` is None and numpy
computes everything. `INSOLE_KERNEL=0` in the environment disables it, to compare the two.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

_INTERFACE = 5  # as in kernel.c: a kernel built from another version of it is left out

kernel: Any = None
if os.environ.get("INSOLE_KERNEL") != "0" and sys.byteorder == "little":
    try:
        _kernel: Any = importlib.import_module("insole_daemon._kernel")
    except ImportError:
        pass
    else:
        kernel = _kernel if _kernel.INTERFACE == _INTERFACE else None
