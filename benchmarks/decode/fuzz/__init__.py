"""Hostile input: one small target a parser, and what drives them all (`python -m benchmarks.decode.fuzz.run`)."""
