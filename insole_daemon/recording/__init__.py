"""Recordings: one trial a folder (insole-recording/1), written live or at once, read, imported and exported."""
