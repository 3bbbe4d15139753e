"""Offline validation of a checkweigher: protocol, tuning and accuracy."""
