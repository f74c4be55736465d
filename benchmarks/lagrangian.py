"""One energy for all joints of the Puma 560, beside the geometric kernel of each joint.

``python benchmarks/lagrangian.py --output lagrangian.jsonl`` learns Gaussian processes
of the kinetic and the potential energy, see ``lagrangian_kernel.py``, from 20 samples
of each of 14 loads, three draws. The torques of all joints follow by Lagrange's
equations, so their covariance is one matrix of 6 n rows. What is in the file is not run
again. ``--report`` prints the tables, beside the rows of the same draws and rank that
``kernels.py`` has measured. ``--check`` compares covariances with differences of the
energies' kernels, and the gradient with differences of the likelihood.

The energies of the loads are related through one K^rho = F F^T. All loads share the
friction f_j1 qd_j qd_j' + f_j2 sgn(qd_j) sgn(qd_j') + f_j3 of joint j. All parameters
are learned together, from several starts, by maximum likelihood.
"""

import argparse
import json
import resource
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
from kernels import LOADS, N_PER_LOAD, TEST_SETS, rows
from kernels import read as known
from lagrangian_kernel import Energy, J, read, torques_by_differences
from scipy.linalg import cho_solve, cholesky, lapack
from scipy.optimize import minimize

from skmtgp.metrics import normalized_mean_squared_error

NOISE = 1e-10  # least noise, as a share of the variance of a torque
LIMITS = -20.0, 20.0  # of logarithms
ARM, LINKS = (J,), tuple(range(1, J + 1))  # one polynomial of all joints; a sum
STAGES = [(ARM, 8, 1200), (ARM, N_PER_LOAD, 300), (LINKS, N_PER_LOAD, 150)]


class Parameters:
    """Where theta has what: the factor F, and logarithms of all else."""

    def __init__(self, rank, links):
        shapes = {"factor": (len(LOADS), rank), "noise": (J,), "friction": (J, 3)}
        for link in links:
            shapes |= {f"v{link}": (link,), f"w{link}": (link - 1, 2)}
            shapes |= {f"c{link}": (1,), f"g{link}": (link, 2)}
        self.shapes, self.links = shapes, links
        ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
        self.size, self._ends = int(ends[-1]), ends[:-1]

    def parts(self, theta):
        """The parts of theta by name."""
        parts = np.split(theta, self._ends)
        shaped = zip(self.shapes.items(), parts, strict=True)
        return {name: part.reshape(shape) for (name, shape), part in shaped}

    def join(self, parts):
        """Theta, from its parts."""
        return np.concatenate([parts[name].ravel() for name in self.shapes])

    def values(self, theta):
        """The parameters by name."""
        parts = self.parts(theta)
        return {name: np.exp(of) for name, of in parts.items()} | {
            "factor": parts["factor"]
        }

    def chain(self, gradients, values):
        """The gradient by theta, from those by the parameters."""
        scaled = {name: of * values[name] for name, of in gradients.items()}
        return self.join(scaled | {"factor": gradients["factor"]})

    def start(self, seed, scale):
        """Where learning begins; `scale` has the torques' deviations."""
        rng = np.random.default_rng(seed)
        found = {name: np.zeros(shape) for name, shape in self.shapes.items()}
        for name, of in found.items():
            if name[0] in "wg":
                of += np.log(0.1) + 0.3 * rng.standard_normal(of.shape)
        found["factor"] += 0.1 * rng.standard_normal(found["factor"].shape)
        found["factor"][:, 0] = 1.0
        found["friction"] += 2.0 * np.log(scale)[:, None]
        found["noise"] += 2.0 * np.log(scale) - 5.0
        return self.join(found)

    def bounds(self, scale):
        """Of each element of theta."""
        found = {name: np.tile(LIMITS, (*of, 1)) for name, of in self.shapes.items()}
        found["factor"] *= np.inf
        found["noise"][:, 0] = np.log(NOISE) + 2.0 * np.log(scale)
        return np.vstack([of.reshape(-1, 2) for of in found.values()])

    def begun(self, arm):
        """Theta, from parts of that of the whole arm: other links begin smaller."""
        found = dict(arm)
        for link in self.links[:-1]:
            found[f"v{link}"] = arm[f"v{J}"][:link] - 1.0  # of k_T the square counts
            found[f"c{link}"] = arm[f"c{J}"] - 2.0
            found[f"w{link}"] = arm[f"w{J}"][: link - 1]
            found[f"g{link}"] = arm[f"g{J}"][:link]
        return self.join(found)


def flat(K):
    """One matrix, of the torques of joint 1, then 2, and so on."""
    n, m = K.shape[2:]
    return K.transpose(0, 2, 1, 3).reshape(J * n, J * m)


class Problem:
    """The likelihood of torques, shape (n, J), at rows of states and loads."""

    def __init__(self, X, torques, parameters):
        self.states, self.loads = read(X), np.searchsorted(LOADS, X[:, -1])
        self.y, self.n, self.parameters = torques.T.ravel(), len(X), parameters
        self.n_evaluations = 0

    def covariance(self, states, loads, values):
        """Of torques at these states and at the rows; its parts."""
        energies = [Energy(tile, self.states, values) for tile in states.tiles()]
        of_energy = np.concatenate([of.covariance() for of in energies], axis=2)
        K_rho = values["factor"][loads] @ values["factor"][self.loads].T
        K = K_rho * of_energy
        for j, f in enumerate(values["friction"]):
            K[j, j] += (states.friction[j] * f) @ self.states.friction[j].T
        return K, (energies, of_energy, K_rho)

    def solve(self, values):
        """Cholesky factor, weights K^-1 y, and the parts of K."""
        K, parts = self.covariance(self.states, self.loads, values)
        K = flat(K)
        K[np.diag_indices_from(K)] += np.repeat(values["noise"], self.n)
        lower = cholesky(K, lower=True, overwrite_a=True, check_finite=False)
        return lower, cho_solve((lower, True), self.y), parts

    def likelihood(self, theta):
        """Its logarithm and the gradient by theta."""
        self.n_evaluations += 1
        values = self.parameters.values(theta)
        lower, alpha, parts = self.solve(values)
        value = -0.5 * alpha @ self.y - np.log(np.diagonal(lower)).sum()
        value -= 0.5 * len(self.y) * np.log(2.0 * np.pi)
        inverse = np.tril(lapack.dpotri(lower, lower=True)[0])
        inverse += np.tril(inverse, -1).T
        W = 0.5 * (np.outer(alpha, alpha) - inverse)
        W = W.reshape(J, self.n, J, self.n).transpose(0, 2, 1, 3)
        gradients = self._contract(np.ascontiguousarray(W), values, *parts)
        return value, self.parameters.chain(gradients, values)

    def _contract(self, W, values, energies, of_energy, K_rho):
        """Sums of W times the derivatives of the covariance, by name."""
        phi, own = self.states.friction, W[np.diag_indices(J)]
        member = np.eye(len(LOADS))[self.loads]
        by_K_rho = member.T @ (W * of_energy).sum((0, 1)) @ member
        by_energy, W, end = Counter(), W * K_rho, 0
        for energy in energies:
            begin, end = end, end + energy.shape[2]
            by_energy.update(energy.contract(W[:, :, begin:end]))
        return dict(by_energy) | {
            "factor": 2.0 * by_K_rho @ values["factor"],
            "friction": np.einsum("jnd,jnd->jd", phi, own @ phi),
            "noise": np.trace(own, axis1=1, axis2=2),
        }

    def climb(self, theta, bounds, max_iter):
        """Theta of a maximum of the likelihood, and its value."""

        def falling(theta):
            try:
                value, gradient = self.likelihood(theta)
            except np.linalg.LinAlgError:
                return 1e10, np.zeros_like(theta)
            return -value, -gradient

        options = {"maxiter": max_iter, "maxfun": 2 * max_iter, "maxcor": 100}
        options |= {"ftol": 1e-9}
        found = minimize(falling, theta, jac=True, bounds=bounds, options=options)
        return found.x, -found.fun

    def predict(self, theta, X, size=400):
        """Means of all torques, shape (n, J)."""
        values = self.parameters.values(theta)
        alpha, means = self.solve(values)[1], []
        for part in (X[i : i + size] for i in range(0, len(X), size)):
            loads = np.searchsorted(LOADS, part[:, -1])
            K = self.covariance(read(part), loads, values)[0]
            means.append((flat(K) @ alpha).reshape(J, -1).T)
        return np.vstack(means)


def memory():
    """Peak memory of the process, MiB."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def learn(X, torques, scale, seed, rank):
    """The problem of each stage, with theta and the likelihood of a mode.

    A few rows of each load first: they find the way in a fraction of the time.
    """
    number = pd.Series(X[:, -1]).groupby(X[:, -1]).cumcount().to_numpy()
    before = None
    for links, n, max_iter in STAGES:
        parameters, few = Parameters(rank, links), number < n
        problem = Problem(X[few], torques[few], parameters)
        if before is None:
            theta = parameters.start(seed, scale)
        elif before.links != links:
            theta = parameters.begun(before.parts(theta))
        before = parameters
        theta, value = problem.climb(theta, parameters.bounds(scale), max_iter)
        print(f"start {seed}, links {links}, n={problem.n}: {value:.1f}", flush=True)
        yield problem, theta, value


def measure(draw, seed, arguments):
    """A row for each joint, of the whole arm and of all links."""
    X, torques = rows(draw, "train", N_PER_LOAD)
    begin, mean, scale = time.perf_counter(), torques.mean(0), torques.std(0)
    rank, n_evaluations, spent = arguments.rank, 0, 0.0
    for problem, theta, value in learn(X, torques - mean, scale, seed, rank):
        n_evaluations += problem.n_evaluations
        common = {
            "model": "arm" if problem.parameters.links == ARM else "links",
            "draw": draw,
            "start": seed,
            "rank": rank,
            "log_marginal_likelihood": value + len(X) * np.log(scale).sum(),
            "n_hyperparameters": theta.size - rank * (rank - 1) // 2,
            "n_evaluations": n_evaluations,
            "seconds": round(time.perf_counter() - begin - spent, 1),
            "memory": memory(),
            "theta": theta.round(4).tolist(),
        }
        if problem.n < len(X):
            continue
        tested = time.perf_counter()
        errors = errors_of(problem, theta, mean, draw, arguments.n_test)
        spent += time.perf_counter() - tested
        yield from (common | of | {"joint": j} for j, of in enumerate(errors, start=1))


def errors_of(problem, theta, mean, draw, n_test):
    """For each joint nMSE on each test set, averaged over the loads."""
    found = [{} for _ in range(J)]
    for subset in TEST_SETS:
        X, torques = rows(draw, subset, n_test)
        predicted = problem.predict(theta, X) + mean
        for y, mu, errors in zip(torques.T, predicted.T, found, strict=True):
            error = normalized_mean_squared_error(y, mu, tasks=X[:, -1])
            errors[f"nmse_{subset}"] = float(error)
    return found


def run(arguments):
    """Measure the draws and starts that the file does not have."""
    done = known(arguments.output)
    done = set(zip(done.draw, done.start, strict=True)) if len(done) else set()
    for seed in range(arguments.starts):
        for draw in arguments.draws:
            for row in [] if (draw, seed) in done else measure(draw, seed, arguments):
                with arguments.output.open("a") as file:
                    file.write(json.dumps(row) + "\n")


def check():
    """Compare with differences, at eight random rows."""
    rng = np.random.default_rng(0)
    X = np.column_stack([rng.uniform(-1.0, 1.0, (8, 3 * J)), np.tile([1, 5], 4)])
    parameters = Parameters(2, LINKS)
    theta = parameters.start(0, np.ones(J))
    theta += 0.3 * rng.standard_normal(theta.size)
    problem = Problem(X, rng.standard_normal((len(X), J)), parameters)
    gradient = problem.likelihood(theta)[1]
    steps = 1e-5 * np.eye(theta.size)
    ahead, behind = (
        np.array([problem.likelihood(theta + sign * step)[0] for step in steps])
        for sign in (1.0, -1.0)
    )
    show("gradient", gradient, (ahead - behind) / 2e-5)
    values = parameters.values(theta)
    K = Energy(read(X[:1]), read(X[1:2]), values).covariance()[:, :, 0, 0]
    show("covariance", K, torques_by_differences(X[0], X[1], values))


def show(name, found, expected):
    """The largest difference, beside the largest number."""
    worst, largest = np.abs(found - expected).max(), np.abs(expected).max()
    print(f"{name}: off by {worst:.1e}, largest element {largest:.1e}")


def report(energy, alone):
    """Print each draw, and the medians over draws: of each, the likeliest start."""
    sums = ["log_marginal_likelihood", "n_hyperparameters", "seconds"]
    likeliest = energy.groupby(["model", "draw"])["log_marginal_likelihood"]
    energy = energy[likeliest.transform("max") == energy["log_marginal_likelihood"]]
    both = pd.concat([energy, alone.assign(model=alone["kernel"])], ignore_index=True)
    cases = both.groupby(["model", "draw"])
    totals = cases[[*sums, "n_evaluations", "memory"]].first()
    of_six = totals.index.get_level_values("model").isin(alone["kernel"])
    totals.loc[of_six, sums] = cases[sums].sum()[of_six]
    print("All joints of a draw. Seconds of kernels.py are those of all its ranks")
    print(totals.round(1).to_string())
    for subset in TEST_SETS:
        by_joint = both.pivot_table(
            index=["model", "draw"], columns="joint", values=f"nmse_{subset}"
        )
        print(f"\nnMSE by joint, {subset}; then medians over draws")
        for table in (by_joint, by_joint.groupby("model").median()):
            print(table.to_string(float_format="{:.2g}".format))


def main():
    """Measure, check, or print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add, results = parser.add_argument, Path(__file__).parent / "results"
    add("--output", type=Path, default=results / "lagrangian.jsonl")
    add("--report", action="store_true", help="print what is measured")
    add("--check", action="store_true", help="compare with differences")
    add("--draws", nargs="+", type=int, default=[0, 1, 2])
    add("--rank", type=int, default=5)
    add("--starts", type=int, default=1)
    add("--n-test", type=int, default=4000, help="rows of each load and test set")
    arguments = parser.parse_args()
    if arguments.check:
        return check()
    if not arguments.report:
        run(arguments)
    alone = known(results / "kernels.jsonl")
    of_rank = alone[alone["rank"] == arguments.rank]
    of_rank = of_rank[of_rank["kernel"].isin(["geometric", "joint"])]
    return report(known(arguments.output), of_rank)


if __name__ == "__main__":
    main()
