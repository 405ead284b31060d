"""The first hour with real boards: observe the bus, compare it with the configuration, write one report."""
