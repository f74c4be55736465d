"""What the peers' sparse models share."""

NO_KAPPA = 1e-20  # K^rho has a diagonal in the peers' kernels: as good as none
JITTER = 1e-12  # of the covariance of the inducing points
JITTERS = 7  # ten times larger each time, where one of them may be tried
