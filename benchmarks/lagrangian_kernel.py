"""Covariances of a robot's torques that follow from one energy, and their derivatives.

The energies have the kernels of G. Giacomuzzo, R. Carli, D. Romeres and A. Dalla
Libera, "A black-box physics-informed estimator based on Gaussian process regression for
robot inverse dynamics identification", IEEE Transactions on Robotics 40, 2024. They are
sums over the links l, whose energies depend on the joints up to l:

    k_T = sum_l 1/2 S_l^2 prod_{1 < i <= l} (1 + w_li . p_i p_i')^2,
    k_V = sum_l c_l prod_{i <= l} (1 + g_li . p_i p_i'),

with S_l = sum_{i <= l} v_li qd_i qd_i' and p_i = (cos q_i, sin q_i), of six joints that
turn. The first joint turns the whole arm, which changes no kinetic energy.
"""

from typing import NamedTuple

import numpy as np

J = 6
STANDSTILL = 1e-9  # rad/s


class States(NamedTuple):
    """Rows of joint states. Joints come first, rows second.

    `squares` and `lines` have shape (2, J, n, k): the monomials of degree at most 2 and
    at most 1 in (cos q, sin q), and their derivatives by q. `friction` has the
    velocity, its sign and one.
    """

    qd: np.ndarray
    qdd: np.ndarray
    friction: np.ndarray
    squares: np.ndarray
    lines: np.ndarray

    def tiles(self, size=40):
        """The states of so many rows each: what fits into the cache."""
        for i in range(0, self.qd.shape[1], size):
            few = slice(i, i + size)
            joints = (of[:, few] for of in self[:3])
            yield States(*joints, *(of[:, :, few] for of in self[3:]))


def read(X):
    """States of rows whose first columns are q, qd and qdd."""
    q, qd, qdd = (X[:, i * J : (i + 1) * J].T for i in range(3))
    c, s, one, zero = np.cos(q), np.sin(q), np.ones_like(q), np.zeros_like(q)
    squares = [one, c, s, c * c, c * s, s * s]
    slopes = [zero, -s, c, -2.0 * c * s, c * c - s * s, 2.0 * c * s]
    signs = np.where(np.abs(qd) > STANDSTILL, np.sign(qd), 0.0)
    return States(
        qd,
        qdd,
        np.stack([qd, signs, one], axis=-1),
        np.stack([np.stack(squares, -1), np.stack(slopes, -1)]),
        np.stack([np.stack([one, c, s], -1), np.stack([zero, -s, c], -1)]),
    )


def variances(w, n_monomials):
    """Of the monomials of (1 + w . p)^2 or 1 + w . p, and their derivatives by w."""
    a, b = w
    if n_monomials == 3:
        return np.array([1.0, a, b]), np.eye(3)[1:]
    D = np.array([1.0, 2 * a, 2 * b, a * a, 2 * a * b, b * b])
    return D, np.array([[0, 2, 0, 2 * a, 2 * b, 0], [0, 0, 2, 0, 2 * a, 2 * b]])


class Products:
    """The product P of the joints' polynomial kernels, and what Lagrange needs of it.

    ``values[a, b]`` is d^2 P / dq_a dq'_b, where joints count from 1 and 0 is no
    derivative.
    """

    def __init__(self, left, right, w):
        self.left, self.right, self.w = left, right, w
        self.factors = [self._factor(i) for i in range(len(w))]
        self.steps = [np.ones((1, 1, left.shape[2], right.shape[2]))]
        for factor in self.factors:
            self.steps.append(self._times(self.steps[-1], factor))
        self.values = self.steps[-1]

    def _factor(self, i):
        """The kernel of a joint, by its position on the left and on the right."""
        D = variances(self.w[i], self.left.shape[-1])[0]
        left, right = self.left[:, i] * D, self.right[:, i]
        return [[left[x] @ right[y].T for y in range(2)] for x in range(2)]

    @staticmethod
    def _times(P, f):
        n = len(P)
        grown = np.empty((n + 1, n + 1, *P.shape[2:]))
        grown[:n, :n], grown[n, n] = P * f[0][0], P[0, 0] * f[1][1]
        grown[n, :n], grown[:n, n] = P[0] * f[1][0], P[:, 0] * f[0][1]
        return grown

    def contract(self, W):
        """Sum of W times the derivatives of the values by w."""
        found = np.empty(self.w.shape)
        for i in reversed(range(len(self.w))):
            P, f, n = self.steps[i], self.factors[i], i + 1
            inner, row, column, corner = W[:n, :n], W[n, :n], W[:n, n], W[n, n]
            by_factor = [
                [(inner * P).sum((0, 1)), (column * P[:, 0]).sum(0)],
                [(row * P[0]).sum(0), corner * P[0, 0]],
            ]
            found[i] = self._contract_factor(i, by_factor)
            W = inner * f[0][0]
            W[0] += row * f[1][0]
            W[:, 0] += column * f[0][1]
            W[0, 0] += corner * f[1][1]
        return found

    def _contract_factor(self, i, W):
        by_D = sum(
            np.einsum("ik,ik->k", self.left[x, i], W[x][y] @ self.right[y, i])
            for x in range(2)
            for y in range(2)
        )
        return variances(self.w[i], self.left.shape[-1])[1] @ by_D


class Kinetic:
    """Covariances K[j, k] of the torques j at x and k at z, from k_T = S^2 P / 2.

    The mass matrix M is a Gaussian process, whose elements have the variances
    (1 + delta_ab) v_a v_b P, and

        tau_j = sum_b (M_jb qdd_b + dM_jb/dt qd_b) - 1/2 sum_ab dM_ab/dq_j qd_a qd_b.

    S, A, B and C are sum_i v_i a_i b'_i of (qd, qd'), (qdd, qd'), (qd, qdd') and
    (qdd, qdd'). P_t and P_u are the derivatives of P in the time of x and of z.
    """

    def __init__(self, x, z, v, products):
        self.v, self.products, P = v, products, products.values
        self.x, self.z = ((of.qd[: len(v)], of.qdd[: len(v)]) for of in (x, z))
        (qd, qdd), (qd_z, qdd_z) = self.x, self.z
        pairs = (qd, qd_z), (qdd, qd_z), (qd, qdd_z), (qdd, qdd_z)
        self.S, self.A, self.B, self.C = ((a.T * v) @ b for a, b in pairs)
        self.P_t = (qd[:, None, :, None] * P[1:]).sum(0)
        self.P_u = (qd_z[:, None] * P[:, 1:]).sum(1)
        self.P_tu = (qd_z[:, None] * self.P_t[1:]).sum(0)

    def values(self):
        """K, of shape (l, l, n, m)."""
        P, P_t, P_u, v = self.products.values, self.P_t, self.P_u, self.v[:, None, None]
        qd, qdd = (v * of[:, :, None] for of in self.x)
        qd_z, qdd_z = (v * of[:, None, :] for of in self.z)
        K = 0.5 * self.S**2 * P[1:, 1:]
        K -= qd_z[:, None] * (self.A * P[0, 1:] + self.S * P_t[1:])
        K -= qd * (self.B * P[1:, 0] + self.S * P_u[1:])[:, None]
        K += qdd * (qdd_z * P[0, 0] + qd_z * P_u[0])[:, None]
        K += qd * (qdd_z * P_t[0] + qd_z * self.P_tu)[:, None]
        same = self.C * P[0, 0] + self.A * P_u[0] + self.B * P_t[0] + self.S * self.P_tu
        K[np.diag_indices(len(v))] += v * same
        return K

    def contract(self, W):
        """Sum of W times the derivatives of K by v and by P.

        All tiles of a symmetric W together have the same sum with a term of K and with
        its transpose. So some terms stand for both:

            v_j v_k (qdd_k qdd'_j P + 2 qdd_k qd'_j P_u + qd_k qd'_j P_tu)
            - 2 v_j qd'_j (A dP/dq'_k + S dP_t/dq'_k) + 1/2 S^2 d^2 P / dq_j dq'_k
            + delta_jk v_j (C P + 2 A P_u + S P_tu)
        """
        v = self.v[:, None, None, None]
        by_qd, by_qdd = ((v * of[:, None, None] * W).sum(0) for of in self.z)
        own = np.einsum("j,jjnm->nm", self.v, W)
        parts = W, by_qd, by_qdd, own
        return self._by_v(*parts), self._by_products(*parts)

    def _by_v(self, W, by_qd, by_qdd, own):
        P, P_t, P_u, P_tu = self.products.values, self.P_t, self.P_u, self.P_tu
        (qd, qdd), (qd_z, qdd_z) = self.x, self.z
        same = self.C * P[0, 0] + 2.0 * self.A * P_u[0] + self.S * P_tu
        row = self.A * P[0, 1:] + self.S * P_t[1:]
        found = np.einsum("jjnm,nm->j", W, same)
        found -= 2.0 * np.einsum("jnm,jm->j", (W * row).sum(1), qd_z)
        found += 2.0 * np.einsum("knm,kn->k", by_qdd * P[0, 0] + by_qd * P_u[0], qdd)
        found += 2.0 * np.einsum("knm,kn->k", by_qdd * P_t[0] + by_qd * P_tu, qd)
        S = self.S * (W * P[1:, 1:]).sum((0, 1)) + own * P_tu
        S -= 2.0 * (by_qd * P_t[1:]).sum(0)
        A = 2.0 * (own * P_u[0] - (by_qd * P[0, 1:]).sum(0))
        for by, a, b in ((S, qd, qd_z), (A, qdd, qd_z), (own * P[0, 0], qdd, qdd_z)):
            found += np.einsum("im,im->i", a @ by, b)
        return found

    def _by_products(self, W, by_qd, by_qdd, own):
        by_P, v = np.empty(self.products.values.shape), self.v[:, None, None]
        qd, qdd = (of[:, :, None] for of in self.x)
        qd_z, S = self.z[0][:, None, :], self.S
        by_tu = (v * qd * by_qd).sum(0) + S * own
        by_u = 2.0 * ((v * qdd * by_qd).sum(0) + self.A * own)
        by_P[0, 0], by_P[1:, 0] = (v * qdd * by_qdd).sum(0) + self.C * own, 0.0
        by_P[0, 1:] = qd_z * by_u - 2.0 * self.A * by_qd
        by_t = qd_z * by_tu - 2.0 * S * by_qd
        by_P[1:, 1:] = 0.5 * S**2 * W + qd[:, None] * by_t
        return by_P


def links_of(values):
    """The links that have parameters."""
    return [link for link in range(1, J + 1) if f"v{link}" in values]


class Energy:
    """Covariances of all torques at x and at z, from the parameters of the energies."""

    def __init__(self, x, z, values):
        self.values, self.parts = values, {}
        for link in links_of(values):
            w = np.vstack([np.zeros((1, 2)), values[f"w{link}"]])
            mass = Products(x.squares, z.squares, w)
            height = Products(x.lines, z.lines, values[f"g{link}"])
            self.parts[link] = Kinetic(x, z, values[f"v{link}"], mass), height
        self.shape = J, J, x.qd.shape[1], z.qd.shape[1]

    def covariance(self):
        """K, of shape (J, J, n, m)."""
        K = np.zeros(self.shape)
        for link, (kinetic, height) in self.parts.items():
            K[:link, :link] += kinetic.values()
            K[:link, :link] += self.values[f"c{link}"] * height.values[1:, 1:]
        return K

    def contract(self, W):
        """Sum of W, a tile of a symmetric one, times the derivatives of K, by name."""
        found = {}
        for link, (kinetic, height) in self.parts.items():
            of_link = W[:link, :link]
            found[f"v{link}"], by_P = kinetic.contract(of_link)
            found[f"w{link}"] = kinetic.products.contract(by_P)[1:]
            found[f"c{link}"] = np.array([(of_link * height.values[1:, 1:]).sum()])
            by_P = np.zeros(height.values.shape)
            by_P[1:, 1:] = self.values[f"c{link}"] * of_link
            found[f"g{link}"] = height.contract(by_P)
        return found


def energy_kernel(left, right, values):
    """k_T + k_V of two states (q, qd), by the formula."""
    (p, qd), (p_, qd_) = (
        (np.array([np.cos(s[:J]), np.sin(s[:J])]), s[J:]) for s in (left, right)
    )
    total = 0.0
    for link in links_of(values):
        dots = (p * p_)[:, :link]
        w = np.vstack([np.zeros((1, 2)), values[f"w{link}"]])
        S = (values[f"v{link}"] * (qd * qd_)[:link]).sum()
        total += 0.5 * S**2 * np.prod(1.0 + (w.T * dots).sum(0)) ** 2
        height = 1.0 + (values[f"g{link}"].T * dots).sum(0)
        total += values[f"c{link}"][0] * np.prod(height)
    return total


def slope(f, h=0.02):
    """Derivative at 0, by five points."""
    return (8.0 * (f(h) - f(-h)) - f(2.0 * h) + f(-2.0 * h)) / (12.0 * h)


def torque(energy, row, j):
    """Lagrange's equation, d/dt dL/dqd_j - dL/dq_j, by differences at (q, qd, qdd)."""
    state, moves, unit = row[: 2 * J], row[J : 3 * J], np.eye(2 * J)
    of_momentum = slope(
        lambda t: slope(lambda h: energy(state + t * moves + h * unit[J + j]))
    )
    return of_momentum - slope(lambda h: energy(state + h * unit[j]))


def torques_by_differences(x, z, values):
    """Covariances of all torques at two rows, from the energy's kernel."""

    def at_x(j, k):
        def of(left):
            return torque(lambda right: energy_kernel(left, right, values), z, k)

        return torque(of, x, j)

    return np.array([[at_x(j, k) for k in range(J)] for j in range(J)])
