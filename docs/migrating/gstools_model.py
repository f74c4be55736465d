"""Ordinary kriging of docs/kriging.md, in GSTools."""

import gstools as gs
import numpy as np
from places import grid, places, values

SILL, LENGTH, NUGGET = 5.971, 1.090, 0.6225  # as skmtgp has learned them

covariance = gs.Exponential(dim=2, var=SILL, len_scale=LENGTH, nugget=NUGGET)
model = gs.krige.Ordinary(covariance, places.T, values, cond_err="nugget")
mean, variance = model(grid.T)
std = np.sqrt(variance)
