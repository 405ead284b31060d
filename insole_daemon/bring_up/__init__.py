"""The first hour with real boards: what the bus says, what differs from the configuration, and one report of it."""
