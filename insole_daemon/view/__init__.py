"""The page: what a daemon publishes, drawn in any browser."""
