"""Ordinary kriging of docs/kriging.md, in PyKrige."""

import numpy as np
from places import grid, places, values
from pykrige.ok import OrdinaryKriging

SILL, LENGTH, NUGGET = 5.971, 1.090, 0.6225  # as skmtgp has learned them

model = OrdinaryKriging(
    *places.T,
    values,
    variogram_model="exponential",  # its range is three lengths
    variogram_parameters={"psill": SILL, "range": 3 * LENGTH, "nugget": NUGGET},
)
mean, variance = model.execute("points", *grid.T)
mean, std = np.asarray(mean), np.sqrt(variance)
