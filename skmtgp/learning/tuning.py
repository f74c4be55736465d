"""The constants of learning, with the reason for each."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Tuning:
    """What learning takes for large, small, many and few.

    Attributes
    ----------
    held : float
        Noise variance while it is held up, in variances of the target: there are few
        modes with so much noise, and it still resolves what a hundredth of the
        deviation is.
    coarse, coarse_per_task : int
        Rows, of complete data inputs, that are learned from first: as many tell the
        modes apart, in a hundredth of a second an evaluation. More with many tasks, of
        which each needs some.
    coarse_share : float
        Fewer than that of noisy data with few features: this share of the rows,
    least_coarse, coarse_per_dim : int
        if these are as many, and as many for each parameter of k^x. The modes of data
        without noise are told by all rows.
    refinement : float
        Most rows in a level for each of the coarser one: a mode of a quarter of the
        rows is near one of all.
    single_tol : float
        Gain in nats under which a climb may end, if likelihoods are computed in single
        precision: their rounding is less.
    relaxed : float
        Standard deviation of the log parameters of k^x where a penalty holds them: far
        wider than what is learned, but not infinite.
    relaxed_tol : float
        Gain in nats under which such a climb ends: another one follows.
    relaxed_patience : int
        Iterations that gain less before it ends.
    doubt : float
        Nats by which a mode that stalled must be better than one that did not, for its
        value lacks digits.
    alike : float
        Nats between the values of points that are taken for the same mode,
    alike_covariance : float
        and the difference of their covariances of f, relative,
    alike_noise : float
        and of the logarithms of their noise variances.
    compared : int
        Rows between which these covariances are.
    look_every : int
        Iterations between two looks whether a climb nears a mode that is known,
    hopeless : float
        or needs so many times what the last of them gained to come as far,
    creeping : float
        where there is noise; without, climbs creep along valleys, and sometimes leap.
    poorer : float
        Nats by which a climb with the noise held up may end below another one, or a
        rank of noisy data be worse than the next: beyond, it is not gone on with.
    vanished : float
        Of the noise that all tasks had: where that of a task is less, it may follow its
        rows.
    full_rank_steps : int
        Most iterations of a full-rank fit that is a start of lower ranks: with many
        tasks and few rows it would end after thousands.
    held_down : int
        Most iterations while the noise is held down: k^x needs no more to take shape.
    lowered : tuple of float
        Noise variance of noisy data while it is held down, of a mode's.
    least_rows : int
        Rows of each task, on average, of which its mean leaves enough to learn from.
    quick : int
        Rows that are learned again without asking what their noise hides.
    tested : int
        Rows that are asked.
    hint : float
        Deviations above zero at which noise hides something: by chance few of some
        dozens of scores are above 3.
    noise_deviation : float
        Of the logarithms of tasks' noise variances: few rows of a task do not tell its
        own.
    rough : float
        Part of a task's rows that is left to the noise, under which functions may have
        followed it,
    rough_rows : int
        if the task has so many rows, at least,
    rougher_than : float
        and if so many times as large a part of another task's is left.
    asleep, awake : float
        Size of functions over the noise under which a mode has none, and where they
        begin again.
    awake_at, awake_beyond : tuple of float, float
        Steps of the logarithms of length-scales where they do, and which they must not
        fall below.
    awakened : float
        Nats that they must gain: in pure noise one of 20 gained as much.
    noise_of_rest : tuple of float
        Noise variances where learning without levels begins, of what is left.
    faster, slower : tuple of float, float
        Steps of the log parameters of k^x to other functions: a length-scale a fifth, a
        twentieth; seven times.
    unused : float
        The same of all features but one.
    swift, less_noise : tuple of float, float
        Steps of length-scales to functions that may have been taken for noise, and the
        factor of the noise variance.
    swifter : float
        Nats that these must gain: in pure noise they gain up to nine.
    most_alone : int
        Features that are tried one by one, too.
    exchanges : int
        How often parameters of two features are exchanged at most,
    most_exchanges : int
        and how many pairs are tried each time: a value takes a third of an evaluation.
    differ, off : float
        Logarithms by which two parameters differ, and one of them is from its bounds,
        where exchanging them matters.
    singular : float
        Of the mean diagonal of K^x, what is added where there is nothing to explain.
    report_every : int
        Iterations between lines of `verbose=2`.
    unsure : float
        Nats by which a sketch of a form of K^rho may be worse than another one, by eq.
        8: beyond, it is not learned.
    vanishing : float
        Share of a task's variance that is its own under which a diagonal's number is
        none: it does not count.
    foreseen : int
        Numbers of rows for which that is asked, from the few that it was learned from.
    weighed_within : float
        Nats an output from the best by eq. 8 within which the evidence chooses, besides
        what eq. 8 may price a form too high.
    rows_told : int
        Rows of each hyperparameter of the best form by eq. 8 under which the evidence
        chooses among all forms, if data have noise: of few rows eq. 8 is far off,
    rows_explained : int
        and if that form explains them without; and of each hyperparameter of a form
        that may be chosen then.
    most_weighed : tuple of int
        Hyperparameters of an output, of few rows and of any number: with more the
        evidence takes too long.
    weighed_work : int
        Hyperparameters times rows, between these.
    rows_weighed : int
        Rows of each hyperparameter of the largest form: with more eq. 8 says much the
        same, and the evidence takes as long as learning does.
    tie : float
        Nats of evidence that are "not worth more than a bare mention" (Kass and Raftery
        1995),
    tie_each : float
        and for each hyperparameter more, as Laplace's method is not exact.
    most_charged : float
        Nats for each hyperparameter that the evidence may be below eq. 8.
    close : float
        Nats from the highest evidence within which eq. 8 may take another form,
    rows_if_close : int
        and how many rows that form has for each hyperparameter.
    overlapping : float
        Share of the rows in the range of another task, under which inputs do not
        overlap,
    rows_apart : int
        if there are no more rows: many tell in any case.
    few_rows : int
        Measurements of a task, on average, under which a rough function of each task
        explains noise as well as functions.
    seldom : float
        Nats taken off unrelated tasks then: "strong" evidence in the same place.
    taken : float
        Share of the noise of other forms, of which functions of each task leave less
    seldom_taken : float
        if so many nats are taken off: "very strong".
    likelier : float
        Nats by which functions that are less smooth must be likelier. Climbs that
        agree end about so far apart.
    long : float
        Deviations of a feature that its length-scale must be longer than where
        functions may be linear,
    linear : float
        and nats by which these must be likelier then: real functions are seldom lines.
    rounds : int
        Of choosing inducing inputs: the second has a kernel that was learned.
    telling : int
        Rows for each parameter of K^rho from which it is learned exactly before the
        bound is: fewer are followed for a long time, to a mode of no use.
    gain, most_gain : float
        Nats a row under which a climb of the bound ends, and in all at most.
    sketched, noisy_patience : int
        Iterations that gain less before a climb of the bound of noisy data ends: the
        first one, which only says where the inducing inputs are to be, and others.
    most_moves : int
        Of all inducing inputs, in a round.
    noises : int
        Noise variances that are tried before the first climb of the bound.
    raised : float
        Times the noise variance before the second: without noise it gets stuck for lack
        of digits.
    apart : tuple of float
        Steps of the log parameters of k^x from those of the terms that are there to
        where a new one may begin: faster by a factor of 4 or 20, slower by one of 7.
    shares : tuple of float
        Variance of a new term where it may begin, of the targets',
    noises_of_joining : tuple of float
        and the noise variance, of that without it: it may have been taken for noise.
    halves : tuple of pairs of float
        Steps from a term's log parameters to those of two that it is split in, and
        either way round where K^rho has different forms.
    unrelated : float
        Correlation under which two rows are not related: if none are where learning
        begins, it cannot leave the place.
    doublings : int
        How many length-scales are tried then, each twice the one before, from the
        shortest that relate most rows.
    most_doublings : int
        Steps to that one at most: kilometres to nanometres.
    much_noise : float
        Noise variance with which they are tried, too, of the targets'.
    noises_of_period : tuple of float
        Noise variances, of the targets', with which periods are tried.
    harmonics : tuple of float
        Times a frequency to others that may be mistaken for it, which are tried, too.
    slow : tuple of float
        Frequencies of trends and of about one cycle, in cycles in the width of the
        data, which are tried, too: a periodogram does not tell them from a slow part,
        and of even rows short periods may explain them otherwise.
    refined : int
        How many of the likeliest periods are compared at the tops of their peaks,
    to_top : tuple of float
        and the steps there, in cycles in the width of the data.
    aperiodic : float
        A period, in widths of the data, of which functions hardly vary,
    repeating : float
        and nats by which a shorter one must be likelier than it: in pure noise one of
        12 is.
    bent : int
        Rows up to which spherical ranges are looked at once more: the likelihood of
        more rows bends less.
    around : float
        Largest step of the logarithm of the range then,
    n_around : int
        how many there are,
    near : float
        and the smallest from which it is climbed again.
    shifts : tuple of float
        Steps of the logarithm of the noise variance with each.
    joining : int
        Starts of a new term that are followed, of each of three sorts.
    followed : int
        Starts of a novel task's row that are followed, of those that are tried.
    together : int
        Samples times parameters of that row below which the likelihoods of all starts
        are computed at once, with second derivatives: these save two iterations of
        three, and a call of a function takes longer than its sums.
    farthest : float
        Largest coordinate of that row: as good as infinite.
    smallest, first : float
        What a novel task has of its own, in root mean squares of the rows: at least,
        and where learning of it starts.
    """

    held: float = 1e-5
    coarse: int = 300
    coarse_per_task: int = 20
    coarse_share: float = 1 / 3
    least_coarse: int = 130
    coarse_per_dim: int = 20
    refinement: float = 4.0
    single_tol: float = 1e-2
    relaxed: float = 5.0
    relaxed_tol: float = 0.3
    relaxed_patience: int = 10
    doubt: float = 1.0
    alike: float = 1.0
    alike_covariance: float = 0.05
    alike_noise: float = 0.2
    compared: int = 100
    look_every: int = 5
    hopeless: float = 5.0
    creeping: float = 50.0
    poorer: float = 30.0
    vanished: float = 1e-2
    full_rank_steps: int = 100
    held_down: int = 20
    lowered: tuple = (1e-3, 1e-1)
    least_rows: int = 3
    quick: int = 60
    tested: int = 300
    hint: float = 4.0
    noise_deviation: float = 1.0
    rough: float = 0.2
    rough_rows: int = 8
    rougher_than: float = 3.0
    asleep: float = 1e-3
    awake: float = 0.3
    awake_at: tuple = (0.0, 0.7, -0.7)
    awake_beyond: float = -1.0
    awakened: float = 3.0
    noise_of_rest: tuple = (1e-1, 1e-2)
    faster: tuple = (-1.5, -3.0)
    slower: float = 2.0
    swift: tuple = (-1.0, -1.6, -2.5)
    less_noise: float = 0.1
    swifter: float = 15.0
    most_alone: int = 10
    unused: float = 3.0
    exchanges: int = 5
    most_exchanges: int = 400
    differ: float = 0.1
    off: float = 1.0
    singular: float = 1e-12
    report_every: int = 100
    unsure: float = 2.0
    vanishing: float = 1e-3
    foreseen: int = 4
    weighed_within: float = 5.0
    most_weighed: tuple = (300, 100)
    weighed_work: int = 300_000
    rows_told: int = 5
    rows_explained: int = 2
    rows_weighed: int = 30
    tie: float = 1.0
    tie_each: float = 0.05
    most_charged: float = 1.5
    close: float = 2.0
    rows_if_close: int = 6
    overlapping: float = 0.5
    rows_apart: int = 3000
    few_rows: int = 5
    seldom: float = 3.0
    taken: float = 0.2
    seldom_taken: float = 5.0
    likelier: float = 0.1
    long: float = 2.0
    linear: float = 3.0
    rounds: int = 2
    telling: int = 4
    gain: float = 1e-4
    most_gain: float = 10.0
    sketched: int = 3
    noisy_patience: int = 12
    most_moves: int = 100
    noises: int = 6
    raised: float = 100.0
    apart: tuple = (-1.5, -3.0, 2.0)
    shares: tuple = (0.3, 0.1, 0.03, 0.01, 0.001)
    noises_of_joining: tuple = (1.0, 0.3)
    halves: tuple = ((0.5, -1.5), (-1.5, 0.5))
    unrelated: float = 1e-3
    doublings: int = 10
    most_doublings: int = 40
    much_noise: float = 0.3
    noises_of_period: tuple = (1e-2, 0.1, 1.0)
    harmonics: tuple = (2.0, 3.0, 0.5)
    slow: tuple = (0.25, 0.5, 0.65, 0.8, 0.95, 1.1)
    refined: int = 2
    to_top: tuple = (0.04, 0.02, 0.01)
    aperiodic: float = 50.0
    repeating: float = 3.0
    bent: int = 1000
    around: float = 1.2
    n_around: int = 21
    near: float = 0.1
    shifts: tuple = (-1.5, -0.5, 0.0, 0.5)
    joining: int = 2
    followed: int = 4
    together: int = 512
    farthest: float = 1e6
    smallest: float = 1e-6
    first: float = 0.1


TUNING = Tuning()
