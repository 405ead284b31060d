"""Calibration: from counts and a reference to the curves of the taxels, offline."""
