"""Pages of the user guide that errors and warnings refer to."""

INFERENCE = "See the user guide, page 'How the likelihood is computed'."
PARALLEL = "See the user guide, page 'All cores, and several machines'."
