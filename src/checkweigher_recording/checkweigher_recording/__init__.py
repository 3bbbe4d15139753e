"""Recordings of a line: bags, CSV logs and simulated lines."""
