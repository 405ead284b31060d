"""A diagnosis as a model the daemon runs."""
