"""Segmentation: one weigh window for each item from samples and edges."""
