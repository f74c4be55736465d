"""Pages of the user guide that errors and warnings refer to."""

FORECASTS = "See the user guide, page 'Forecasts'."
INFERENCE = "See the user guide, page 'Speed and large data'."
LEVELS = "See the user guide, page 'Tasks with different levels'."
NOISE = "See the user guide, page 'Noise'."
PARALLEL = "See the user guide, page 'Parallel computing: cores and clusters'."
