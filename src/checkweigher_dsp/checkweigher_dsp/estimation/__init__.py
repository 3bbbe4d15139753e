"""Estimation: the mass of an item and its uncertainty from a denoised window."""
