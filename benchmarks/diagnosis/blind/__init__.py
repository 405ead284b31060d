"""The blind benchmark of the diagnosis: it conceals physics, seals the truth, and scores the answers.

It shares no module and no constant with the package that it examines, only the file formats.
"""
