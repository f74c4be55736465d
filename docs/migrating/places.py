"""Data of docs/kriging.md: 60 places, what was measured there, and a grid."""

import numpy as np

rng = np.random.default_rng(0)
places = rng.uniform(0.0, 10.0, (60, 2))  # km
side = np.linspace(0.5, 9.5, 7)
grid = np.array([(east, north) for north in side for east in side])
everywhere = np.vstack([places, grid])
apart = np.linalg.norm(everywhere[:, None] - everywhere, axis=2)
field = np.linalg.cholesky(np.exp(-apart / 2.0) + 1e-9 * np.eye(len(apart)))
field = field @ rng.standard_normal(len(apart))
values = 20.0 + 3.0 * field[:60] + 0.8 * rng.standard_normal(60)
