import re

import building
import numpy as np
import pytest
import textbook
from samples import Listener
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.learning import paper
from skmtgp.learning.climbing import climb
from skmtgp.learning.paper import learn_simultaneously, learn_staged
from skmtgp.learning.stages import (
    augmented_task_covariance,
    first_stage,
    full_rank_start,
    perturbed,
)
from skmtgp.model.task_covariance import identity, low_rank, ones

M = 3
KERNEL = ConstantKernel(1.0) * RBF([1.0, 1.0])
RELATED = np.array([[1.0, 0.6, 0.5], [0.6, 1.0, -0.3], [0.5, -0.3, 1.0]])
TASKS = {"like one": 0.95 * np.ones((M, M)) + 0.05 * np.eye(M), "unlike": np.eye(M)}
FORMS = [low_rank(M, 1), low_rank(M, 2), low_rank(M, 2, diagonal=True)]


def draw(K_rho, seed=0, per_task=10):
    """Data of the model itself; tasks share some of the inputs."""
    rng = np.random.default_rng(seed)
    tasks = np.repeat(np.arange(len(K_rho)), per_task)
    X = rng.uniform(-2.0, 2.0, (len(tasks), 2))
    X[-5:] = X[:5]
    kernel = ConstantKernel(1.0) * RBF([0.7, 2.0])
    C = np.linalg.cholesky(textbook.covariance(kernel, K_rho, 0.01, X, tasks))
    return building.data(X, tasks, C @ rng.standard_normal(len(X)), len(K_rho))


def pose(data, **changes):
    form = identity(data.n_tasks)
    return building.problem(KERNEL, form, data, **{"max_iter": 100} | changes)


def by_hand(problem, form, fixed):
    """The three steps of section 3, with K_0^rho fixed."""
    first, last = problem.with_form(fixed), problem.with_form(form)
    log_noise = np.full(problem.prior.n_noise, problem.prior.log_noise)
    mode = climb(first, np.concatenate([KERNEL.theta, log_noise]))  # step 1
    posterior = first.likelihood().posterior(mode.theta)
    K_aug = augmented_task_covariance(problem.data, posterior)  # step 2
    rho = form.parameters(K_aug, problem.budget.truncation)
    theta = np.concatenate([mode.theta[: KERNEL.n_dims], rho, log_noise])
    return mode, climb(last, theta)  # step 3


def assert_same(mode, other):
    np.testing.assert_array_equal(mode.theta, other.theta)
    assert (mode.value, mode.n_iter) == (other.value, other.n_iter)


class TestStaged:
    @pytest.mark.parametrize("tasks", TASKS)
    @pytest.mark.parametrize("n_noise", [1, M])
    @pytest.mark.parametrize("truncation", ["eigen", "cholesky"])
    def test_the_three_steps_from_the_likelier_start(self, tasks, n_noise, truncation):
        problem = pose(draw(TASKS[tasks]), truncation=truncation, n_noise=n_noise)
        [modes] = learn_staged([problem], FORMS)
        for form, mode in zip(FORMS, modes, strict=True):
            alone, apart = by_hand(problem, form, identity(M))
            alike, together = by_hand(problem, form, ones(M))
            assert (alike.value > alone.value) == (tasks == "like one")
            expected = together if tasks == "like one" else apart
            assert_same(mode, expected)
            spent = [alone, alike, expected]
            assert mode.n_evaluations == sum(found.n_evaluations for found in spent)
            assert mode.seconds > 0.0

    def test_the_likelihood_of_the_start_chooses_not_that_of_the_end(self, monkeypatch):
        """A start that is likelier but leads to a worse mode is followed all the same:
        the heuristic of the paper to the letter."""
        problem = pose(draw(RELATED), max_iter=5)
        starts = [
            first_stage(problem.with_form(form(M)), relaxed=False)
            for form in (identity, ones)
        ]
        for likelier in (0, 1):
            followed = []
            promoted = [
                start._replace(mode=start.mode._replace(value=float(k == likelier)))
                for k, start in enumerate(starts)
            ]

            def spy(problem, theta, followed=followed):
                followed.append(theta)
                return climb(problem, theta)

            monkeypatch.setattr(paper, "climb", spy)
            monkeypatch.setattr(
                paper, "make_starts", lambda *_, promoted=promoted, **__: [promoted]
            )
            learn_staged([problem], FORMS[:1])
            expected = starts[likelier].theta(problem.with_form(FORMS[0]))
            np.testing.assert_array_equal(followed, [expected])

    def test_all_rows_at_once(self):
        problem = pose(draw(RELATED), max_iter=3, coarse=6, coarse_per_task=2)
        assert len(problem.coarse_to_fine()) > 1
        for learn in (learn_staged, learn_simultaneously):
            [[mode]] = learn([problem], FORMS[:1], seeds=(0,))
            assert mode.n_samples == len(problem.data)

    def test_more_starts(self, monkeypatch):
        problem, form = pose(draw(RELATED), max_iter=20), FORMS[1]
        one = first_stage(problem.with_form(identity(M)), relaxed=False)
        followed = []

        def spy(problem, theta):
            followed.append(climb(problem, theta))
            return followed[-1]

        monkeypatch.setattr(paper, "climb", spy)
        [[mode]] = learn_staged([problem], [form], seeds=(5, 6, 7))
        assert len(followed) == 4
        assert mode.value == max(found.value for found in followed)
        full, formed = full_rank_start(problem, one), problem.with_form(form)
        more = [full, perturbed(one, 6), perturbed(one, 7)]
        for found, start in zip(followed[1:], more, strict=True):
            assert_same(found, climb(formed, start.theta(formed)))
        other = first_stage(problem.with_form(ones(M)), relaxed=False)
        spent = [*followed, one.mode, other.mode, full.mode]
        assert mode.n_evaluations == sum(found.n_evaluations for found in spent)

    def test_one_task(self):
        problem, form = pose(draw(np.ones((1, 1)), per_task=20)), low_rank(1, 1)
        [[mode]] = learn_staged([problem], [form])
        truth = np.r_[np.log([1.0, 0.7, 2.0]), 1.0, np.log(0.01)]
        assert mode.value > problem.with_form(form).likelihood().value(truth)


class TestSimultaneous:
    @pytest.mark.parametrize("form", FORMS, ids=str)
    def test_starts(self, form, monkeypatch):
        """theta_0^x, sigma_0^2 and K_0^rho of the rank of the model, one for each."""
        problem, followed = pose(draw(RELATED), max_iter=3), []

        def spy(problem, theta):
            followed.append(theta)
            return climb(problem, theta)

        monkeypatch.setattr(paper, "climb", spy)
        learn_simultaneously([problem], [form], seeds=range(4))
        likelihood = problem.with_form(form).likelihood()
        assert len(followed) == 4
        traces = []
        for theta in followed:
            kernel, rho, log_noise = building.parts(likelihood, theta)
            np.testing.assert_array_equal(kernel, KERNEL.theta)
            np.testing.assert_array_equal(log_noise, problem.prior.log_noise)
            F = form.columns(rho)
            assert np.linalg.matrix_rank(F) == form.rank
            traces.append(np.trace(form.matrix(rho)))
        assert len(set(traces)) == 4
        assert 0.2 < np.mean(traces) / M < 3.0  # scaled targets have a variance of 1

    def test_the_best_start_counts(self):
        problem, form = pose(draw(RELATED), max_iter=20), FORMS[1]
        each = [
            learn_simultaneously([problem], [form], seeds=[seed])[0][0]
            for seed in (3, 4, 5)
        ]
        [[mode]] = learn_simultaneously([problem], [form], seeds=[3, 4, 5])
        best = max(each, key=lambda mode: mode.value)
        assert_same(mode, best)
        assert len({found.value for found in each}) > 1
        assert mode.n_evaluations == sum(found.n_evaluations for found in each)


@pytest.mark.parametrize("learn", [learn_staged, learn_simultaneously])
class TestBoth:
    def test_ends_at_a_mode_no_worse_than_the_truth(self, learn):
        problem, form = pose(draw(RELATED), tol=1e-5, max_iter=500), low_rank(M, M)
        [[mode]] = learn([problem], [form], seeds=range(3))
        likelihood = problem.with_form(form).likelihood()
        rho = form.parameters(RELATED)
        truth = np.concatenate([np.log([1.0, 0.7, 2.0]), rho, np.log([0.01])])
        assert mode.converged
        assert mode.value > likelihood.value(truth)
        np.testing.assert_allclose(mode.value, likelihood.value(mode.theta), rtol=1e-10)

    def test_outputs_and_forms_are_learned_separately(self, learn):
        problems = [pose(draw(RELATED, seed), max_iter=10) for seed in (0, 1)]
        both = learn(problems, FORMS, seeds=(1,))
        for problem, modes in zip(problems, both, strict=True):
            for form, mode in zip(FORMS, modes, strict=True):
                [[alone]] = learn([problem], [form], seeds=(1,))
                assert_same(mode, alone)

    @pytest.mark.long
    def test_processes_do_not_matter(self, learn):
        problems = [pose(draw(RELATED), max_iter=3)]
        [one] = learn(problems, FORMS[:2], seeds=(1,))
        [two] = learn(problems, FORMS[:2], seeds=(1,), n_jobs=2)
        for mode, other in zip(one, two, strict=True):
            assert_same(mode, other)

    def test_report(self, learn):
        problems = [pose(draw(RELATED), max_iter=1, name="torque")]
        listener = Listener()
        learn(problems, FORMS[:2], seeds=(1,), progress=listener)
        lines = [line for line in listener.lines if line]
        starts = [re.sub(r"log likelihood -?\d+\.\d|\(.*", "", of) for of in lines]
        n = 2 if learn is learn_staged else 1  # its own, and one for each seed
        each = ", best of 2 starts" if n == 2 else ""
        assert starts == [f"torque, rank {rank}: {each} " for rank in (1, 2)]
        assert listener.stages == [("learning", 2 * n)]
