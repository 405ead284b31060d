"""Export a diagnosis as a model that the daemon runs."""
