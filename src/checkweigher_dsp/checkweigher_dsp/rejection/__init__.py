"""Rejection: the verdict on each item and the time by which the rejector needs it."""
