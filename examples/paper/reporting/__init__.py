"""The page: what follows from the results, as tables, plots and goals."""
