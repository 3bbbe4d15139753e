"""Findings on the health of each stage."""
