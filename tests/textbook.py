"""Gaussian processes by the book: small, plain and independent of skmtgp.

Rasmussen and Williams (2006), eqs. 2.23 to 2.30, with the covariance of eq. 6. `level`
is the variance of the tasks' levels, which are part of f, `noise` that of the noise:
one number, or one for each task. The ``exact_*`` functions do it again with fifty
digits.
"""

from decimal import Decimal, getcontext

import numpy as np

getcontext().prec = 50


def of_rows(of_tasks, tasks):
    """For each row, from one number or one for each task."""
    of_tasks = np.ravel(of_tasks)
    return of_tasks[tasks] if len(of_tasks) > 1 else np.repeat(of_tasks, len(tasks))


def cross_covariance(kernel, K_rho, X, tasks, Z, tasks_of_Z, level=0.0):
    """cov(f(X), f(Z))."""
    levels = of_rows(level, tasks)[:, None] * np.equal.outer(tasks, tasks_of_Z)
    return K_rho[np.ix_(tasks, tasks_of_Z)] * kernel(X, Z) + levels


def prior_covariance(kernel, K_rho, X, tasks, level=0.0):
    """cov(f(X))."""
    levels = of_rows(level, tasks)[:, None] * np.equal.outer(tasks, tasks)
    return K_rho[np.ix_(tasks, tasks)] * kernel(X) + levels


def covariance(kernel, K_rho, noise, X, tasks, level=0.0):
    """cov(y)."""
    K = prior_covariance(kernel, K_rho, X, tasks, level)
    return K + np.diag(of_rows(noise, tasks))


def log_marginal_likelihood(K, y):
    """log N(y | 0, K)."""
    sign, log_det = np.linalg.slogdet(K)
    assert sign > 0
    return -0.5 * (y @ np.linalg.solve(K, y) + log_det + len(y) * np.log(2.0 * np.pi))


def posterior(kernel, K_rho, noise, X, tasks, y, Z, tasks_of_Z, level=0.0):
    """Mean and covariance of f(Z) given y."""
    K = covariance(kernel, K_rho, noise, X, tasks, level)
    K_star = cross_covariance(kernel, K_rho, X, tasks, Z, tasks_of_Z, level)
    prior = prior_covariance(kernel, K_rho, Z, tasks_of_Z, level)
    mean = K_star.T @ np.linalg.solve(K, y)
    return mean, prior - K_star.T @ np.linalg.solve(K, K_star)


def restricted_likelihood(K, H, y):
    """Harville (1974): log density of A^T y with A^T A = I - H (H^T H)^{-1} H^T."""
    inverse, n, p = np.linalg.inv(K), *H.shape
    of_beta = H.T @ inverse @ H
    P = inverse - inverse @ H @ np.linalg.inv(of_beta) @ H.T @ inverse
    log_dets = [np.linalg.slogdet(of)[1] for of in (K, of_beta, H.T @ H)]
    return -0.5 * (
        y @ P @ y
        + log_dets[0]
        + log_dets[1]
        - log_dets[2]
        + (n - p) * np.log(2 * np.pi)
    )


def universal_kriging(K, H, y, K_star, H_star, prior):
    """Mean and covariance of f with its trend, of flat coefficients; those, and theirs.

    K_star is between rows and new ones, `prior` that of f at the new ones. Rasmussen
    and Williams (2006), eqs. 2.41 and 2.42.
    """
    inverse = np.linalg.inv(K)
    covariance = np.linalg.inv(H.T @ inverse @ H)
    beta = covariance @ H.T @ inverse @ y
    R = H_star - K_star.T @ inverse @ H
    mean = H_star @ beta + K_star.T @ inverse @ (y - H @ beta)
    spread = prior - K_star.T @ inverse @ K_star + R @ covariance @ R.T
    return mean, spread, beta, covariance


def low_rank(F, kappa=None):
    """sum_r F_r F_r^T (+ diag(kappa)), entry by entry."""
    M, rank = F.shape
    K = np.zeros((M, M))
    for m in range(M):
        for n in range(M):
            K[m, n] = sum(F[m, r] * F[n, r] for r in range(rank))
            K[m, n] += kappa[m] if kappa is not None and m == n else 0.0
    return K


def derivative(f, x, step=1e-3):
    """df / dx_p by central differences of fourth order; f may return an array."""

    def along(e):
        near = np.asarray(f(x + e)) - np.asarray(f(x - e))
        far = np.asarray(f(x + 2 * e)) - np.asarray(f(x - 2 * e))
        return (8.0 * near - far) / (12.0 * step)

    return np.array([along(e) for e in step * np.eye(len(x))])


def exact_covariance(K_rho, noise, X, tasks, Z, tasks_of_Z, level=0.0):
    """Rows of Decimals: K^rho exp(-|x - z|^2 / 2), levels, and noise where Z is X."""

    def k(x, m, z, o):
        s = sum((Decimal(a) - Decimal(b)) ** 2 for a, b in zip(x, z, strict=True))
        of_level = Decimal(level) if m == o else Decimal(0)
        return Decimal(K_rho[m, o]) * (-s / 2).exp() + of_level

    K = [
        [k(x, m, z, o) for z, o in zip(Z.tolist(), tasks_of_Z, strict=True)]
        for x, m in zip(X.tolist(), tasks, strict=True)
    ]
    for i in range(len(K) if Z is X else 0):
        K[i][i] += Decimal(noise)
    return K


def exact_solve(K, b):
    """K^{-1} b and the log-determinant of K, by Gaussian elimination."""
    K, b = [list(row) for row in K], [Decimal(value) for value in b]
    n = len(K)
    for i in range(n):
        for j in range(i + 1, n):
            ratio = K[j][i] / K[i][i]
            K[j] = [u - ratio * v for u, v in zip(K[j], K[i], strict=True)]
            b[j] -= ratio * b[i]
    log_det = sum(K[i][i].ln() for i in range(n))
    for i in reversed(range(n)):
        b[i] = (b[i] - sum(K[i][j] * b[j] for j in range(i + 1, n))) / K[i][i]
    return b, log_det


def exact_log_marginal_likelihood(K_rho, noise, X, tasks, y, level=0.0):
    """log N(y | 0, K) with k^x = exp(-|x - x'|^2 / 2)."""
    K = exact_covariance(K_rho, noise, X, tasks, X, tasks, level)
    alpha, log_det = exact_solve(K, y.tolist())
    fit = sum(Decimal(t) * a for t, a in zip(y.tolist(), alpha, strict=True))
    return float(-(fit + log_det) / 2) - 0.5 * len(y) * np.log(2.0 * np.pi)


def exact_mean(K_rho, noise, X, tasks, y, Z, tasks_of_Z, level=0.0):
    """Posterior mean of f(Z) with k^x = exp(-|x - x'|^2 / 2)."""
    K = exact_covariance(K_rho, noise, X, tasks, X, tasks, level)
    alpha, _ = exact_solve(K, y.tolist())
    K_star = exact_covariance(K_rho, noise, Z, tasks_of_Z, X, tasks, level)
    return np.array(
        [float(sum(k * a for k, a in zip(row, alpha, strict=True))) for row in K_star]
    )
