"""The compiled kernel, where this installation has one.

`kernel.c` does what a cycle costs most in, to the bit as the numpy code beside each call of it. It is built with the
package where there is a C compiler with Python's headers; elsewhere `kernel` is None and numpy does all of it.
`INSOLE_KERNEL=0` in the environment has it left out, to compare the two.
"""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

_INTERFACE = 4  # as in kernel.c: a kernel built from another version of it is left out

kernel: Any = None
if os.environ.get("INSOLE_KERNEL") != "0" and sys.byteorder == "little":
    try:
        _kernel: Any = importlib.import_module("insole_daemon._kernel")
    except ImportError:
        pass
    else:
        kernel = _kernel if _kernel.INTERFACE == _INTERFACE else None
