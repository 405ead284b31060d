"""Decoding of skin frames: identifiers, halves, status bits; frames into cycles; the layout."""
