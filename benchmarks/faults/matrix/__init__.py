"""The fault matrix: every fault that a lab knows, done to `insole run` on a real vcan; see __main__.py."""
