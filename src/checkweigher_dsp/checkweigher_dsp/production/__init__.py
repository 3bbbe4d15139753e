"""Production: recipes, prepackages, statistics and the audit log."""
