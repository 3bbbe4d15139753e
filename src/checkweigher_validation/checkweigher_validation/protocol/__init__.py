"""The protocol of the paper on a simulated machine, and the bound of any estimate."""
