"""Accuracy of estimators: passes of known mass, errors, classes and tables."""
