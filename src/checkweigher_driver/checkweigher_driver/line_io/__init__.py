"""Rejector, stop and photo-eyes on the wires of the machine."""
