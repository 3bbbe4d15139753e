"""A simulated weigh belt."""
