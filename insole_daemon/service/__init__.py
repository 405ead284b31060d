"""The daemon: the loop that turns frames into messages, its readiness and its end."""
