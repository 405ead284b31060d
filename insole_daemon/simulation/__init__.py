"""Simulated hardware: loads of a person or a chamber, and boards that speak the protocol."""
