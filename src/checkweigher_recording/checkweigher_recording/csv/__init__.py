"""CSV logs of other systems."""
