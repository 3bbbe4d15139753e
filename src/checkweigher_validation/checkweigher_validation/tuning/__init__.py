"""Learning the parameters of the estimators from passes of known mass."""
