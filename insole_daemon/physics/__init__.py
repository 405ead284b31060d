"""The sensor model: counts to pressure, and the effects beyond the static curve."""
