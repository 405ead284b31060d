"""Pressure into wrench, centre of pressure and contact."""
