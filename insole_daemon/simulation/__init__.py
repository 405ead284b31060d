"""What cannot be had without hardware: a foot that walks, boards that speak the protocol."""
