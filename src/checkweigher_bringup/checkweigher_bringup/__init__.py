"""Bringing up a checkweigher: the one-process line and the command line."""
