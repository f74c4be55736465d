"""What the peers' sparse models share."""

NO_KAPPA = 1e-20  # K^rho has a diagonal in the peers' kernels: as good as none
JITTERS = tuple(10.0**power for power in range(-13, -4))  # tried in this order
