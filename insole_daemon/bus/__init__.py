"""CAN frames in and out, as batches of arrays."""
