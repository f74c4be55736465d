"""The base classes of the estimators, in the order in which they are read."""
