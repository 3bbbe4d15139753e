"""Commissioning at the belt: calibration with masses at rest, setting with passes of known mass."""
