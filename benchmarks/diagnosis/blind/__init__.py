"""The blind benchmark of the diagnosis: it conceals physics, seals what it concealed, and scores the answers.

Shares no module and no constant with the package it examines; what both know is the files of the contract.
"""
