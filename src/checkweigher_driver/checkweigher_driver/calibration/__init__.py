"""Static calibration of a load cell."""
