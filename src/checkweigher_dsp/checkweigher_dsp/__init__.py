"""The weighing of an in-motion checkweigher: stages, estimators and their nodes."""
