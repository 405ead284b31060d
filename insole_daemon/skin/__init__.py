"""What the frames mean: identifiers, halves, status bits; frames into cycles; where every taxel lies."""
