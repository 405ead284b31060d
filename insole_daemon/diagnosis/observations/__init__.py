"""Recordings as data for a regression: readings at the times they were taken, and the reference beside them."""
