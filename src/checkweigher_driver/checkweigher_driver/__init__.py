"""The machine's side of a checkweigher: sources of samples and photo-eye edges, and their node."""
