"""Pages of the user guide that errors and warnings refer to."""

INFERENCE = "See the user guide, page 'How the likelihood is computed'."
NOISE = "See the user guide, page 'Noise, and data without it'."
PARALLEL = "See the user guide, page 'All cores, and several machines'."
