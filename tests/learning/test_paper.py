import building
import numpy as np
import pytest
import textbook
from samples import Listener
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from skmtgp.learning import paper, problem
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


def configure(**changes):
    return building.settings(**{"kernel": KERNEL, "max_iter": 100} | changes)


def by_hand(data, settings, form, fixed):
    """The three steps of section 3, with K_0^rho fixed."""
    theta = np.concatenate([settings.kernel.theta, settings.log_noise])
    mode = climb(data, settings, fixed, theta)  # step 1
    posterior = settings.likelihood(data, fixed).posterior(mode.theta)
    K_aug = augmented_task_covariance(data, posterior)  # step 2
    rho = form.parameters(K_aug, settings.truncation)
    theta = np.concatenate([mode.theta[: KERNEL.n_dims], rho, settings.log_noise])
    return mode, climb(data, settings, form, theta)  # step 3


def assert_same(mode, other):
    np.testing.assert_array_equal(mode.theta, other.theta)
    assert (mode.value, mode.n_iter) == (other.value, other.n_iter)


class TestStaged:
    @pytest.mark.parametrize("tasks", TASKS)
    @pytest.mark.parametrize("n_noise", [1, M])
    @pytest.mark.parametrize("truncation", ["eigen", "cholesky"])
    def test_the_three_steps_from_the_likelier_start(self, tasks, n_noise, truncation):
        data = draw(TASKS[tasks])
        log_noise = np.full(n_noise, np.log(0.1))
        settings = configure(truncation=truncation, log_noise=log_noise)
        [modes] = learn_staged([(data, settings)], FORMS)
        for form, mode in zip(FORMS, modes, strict=True):
            alone, apart = by_hand(data, settings, form, identity(M))
            alike, together = by_hand(data, settings, form, ones(M))
            assert (alike.value > alone.value) == (tasks == "like one")
            expected = together if tasks == "like one" else apart
            assert_same(mode, expected)
            spent = [alone, alike, expected]
            assert mode.n_evaluations == sum(found.n_evaluations for found in spent)
            assert mode.seconds > 0.0

    def test_the_likelihood_of_the_start_chooses_not_that_of_the_end(self, monkeypatch):
        """A start that is likelier but leads to a worse mode is followed all the same:
        the heuristic of the paper to the letter."""
        data, settings = draw(RELATED), configure(max_iter=5)
        starts = [
            first_stage(data, settings, form(M), relaxed=False)
            for form in (identity, ones)
        ]
        for likelier in (0, 1):
            followed = []
            promoted = [
                start._replace(mode=start.mode._replace(value=float(k == likelier)))
                for k, start in enumerate(starts)
            ]

            def spy(data, settings, form, theta, followed=followed):
                followed.append(theta)
                return climb(data, settings, form, theta)

            monkeypatch.setattr(paper, "climb", spy)
            monkeypatch.setattr(
                paper, "make_starts", lambda *_, promoted=promoted, **__: [promoted]
            )
            learn_staged([(data, settings)], FORMS[:1])
            expected = starts[likelier].theta(settings, FORMS[0])
            np.testing.assert_array_equal(followed, [expected])

    def test_all_rows_at_once(self, monkeypatch):
        monkeypatch.setattr(problem, "COARSE", 6)
        monkeypatch.setattr(problem, "COARSE_PER_TASK", 2)
        data, settings = draw(RELATED), configure(max_iter=3)
        assert len(data.levels()) > 1
        for learn in (learn_staged, learn_simultaneously):
            [[mode]] = learn([(data, settings)], FORMS[:1], seeds=(0,))
            assert mode.n_samples == len(data.y)

    def test_more_starts(self, monkeypatch):
        data, settings, form = draw(RELATED), configure(max_iter=20), FORMS[1]
        one = first_stage(data, settings, identity(M), relaxed=False)
        followed = []

        def spy(data, settings, form, theta):
            followed.append(climb(data, settings, form, theta))
            return followed[-1]

        monkeypatch.setattr(paper, "climb", spy)
        [[mode]] = learn_staged([(data, settings)], [form], seeds=(5, 6, 7))
        assert len(followed) == 4
        assert mode.value == max(found.value for found in followed)
        full = full_rank_start(data, settings, one)
        more = [full, perturbed(one, 6), perturbed(one, 7)]
        for found, start in zip(followed[1:], more, strict=True):
            expected = climb(data, settings, form, start.theta(settings, form))
            assert_same(found, expected)
        other = first_stage(data, settings, ones(M), relaxed=False)
        spent = [*followed, one.mode, other.mode, full.mode]
        assert mode.n_evaluations == sum(found.n_evaluations for found in spent)

    def test_one_task(self):
        data, settings = draw(np.ones((1, 1)), per_task=20), configure()
        [[mode]] = learn_staged([(data, settings)], [low_rank(1, 1)])
        truth = np.r_[np.log([1.0, 0.7, 2.0]), 1.0, np.log(0.01)]
        value = settings.likelihood(data, low_rank(1, 1)).value(truth)
        assert mode.value > value


class TestSimultaneous:
    @pytest.mark.parametrize("form", FORMS, ids=str)
    def test_starts(self, form, monkeypatch):
        """theta_0^x, sigma_0^2 and K_0^rho of the rank of the model, one for each."""
        data, settings, followed = draw(RELATED), configure(max_iter=3), []

        def spy(data, settings, form, theta):
            followed.append(theta)
            return climb(data, settings, form, theta)

        monkeypatch.setattr(paper, "climb", spy)
        learn_simultaneously([(data, settings)], [form], seeds=range(4))
        split = settings.likelihood(data, form).split
        assert len(followed) == 4
        for theta in followed:
            kernel, rho, log_noise = split(theta)
            np.testing.assert_array_equal(kernel, KERNEL.theta)
            np.testing.assert_array_equal(log_noise, settings.log_noise)
            F = form.columns(rho)
            assert np.linalg.matrix_rank(F) == form.rank
        traces = [np.trace(form.matrix(split(theta)[1])) for theta in followed]
        assert len(set(traces)) == 4
        assert 0.2 < np.mean(traces) / M < 3.0  # scaled targets have a variance of 1

    def test_the_best_start_counts(self):
        data, settings, form = draw(RELATED), configure(max_iter=20), FORMS[1]
        each = [
            learn_simultaneously([(data, settings)], [form], seeds=[seed])[0][0]
            for seed in (3, 4, 5)
        ]
        [[mode]] = learn_simultaneously([(data, settings)], [form], seeds=[3, 4, 5])
        best = max(each, key=lambda mode: mode.value)
        assert_same(mode, best)
        assert len({found.value for found in each}) > 1
        assert mode.n_evaluations == sum(found.n_evaluations for found in each)


@pytest.mark.parametrize("learn", [learn_staged, learn_simultaneously])
class TestBoth:
    def test_ends_at_a_mode_no_worse_than_the_truth(self, learn):
        data, settings = draw(RELATED), configure(tol=1e-5, max_iter=500)
        form = low_rank(M, M)
        [[mode]] = learn([(data, settings)], [form], seeds=range(3))
        likelihood = settings.likelihood(data, form)
        rho = form.parameters(RELATED)
        truth = np.concatenate([np.log([1.0, 0.7, 2.0]), rho, np.log([0.01])])
        assert mode.converged
        assert mode.value > likelihood.value(truth)
        np.testing.assert_allclose(mode.value, likelihood.value(mode.theta), rtol=1e-10)

    def test_outputs_and_forms_are_learned_separately(self, learn):
        pairs = [(draw(RELATED, seed), configure(max_iter=10)) for seed in (0, 1)]
        both = learn(pairs, FORMS, seeds=(1,))
        for pair, modes in zip(pairs, both, strict=True):
            for form, mode in zip(FORMS, modes, strict=True):
                [[alone]] = learn([pair], [form], seeds=(1,))
                assert_same(mode, alone)

    def test_processes_do_not_matter(self, learn):
        pairs = [(draw(RELATED), configure(max_iter=3))]
        [one] = learn(pairs, FORMS[:2], seeds=(1,))
        [two] = learn(pairs, FORMS[:2], seeds=(1,), n_jobs=2)
        for mode, other in zip(one, two, strict=True):
            assert_same(mode, other)

    def test_report(self, learn):
        pairs = [(draw(RELATED), configure(max_iter=1, name="torque"))]
        listener = Listener()
        learn(pairs, FORMS[:2], seeds=(1,), progress=listener)
        lines = [line for line in listener.lines if line]
        starts = [line.split(": log marginal likelihood")[0] for line in lines]
        n = 2 if learn is learn_staged else 1  # its own, and one for each seed
        each = ", the best of 2 starts" if n == 2 else ""
        assert starts == [f"torque, rank {rank}{each}" for rank in (1, 2)]
        assert listener.stages == [("learning", 2 * n)]
