"""Zenoh: keys, messages, the session, and the client that other programs import."""
