"""Learning: maximising the marginal likelihood.

``problem`` has what is learned and the modes that are found, ``tuning`` the constants.
``screening`` asks a small model in which units, and with which noise, to learn.
``climbing`` follows one start to a mode, ``stages`` is the paper's section 3, ``ranks``
learns several ranks, which help each other by ``nesting``, and ``summarised`` goes on
from there with inducing inputs, to ranks that need all rows by ``growing``. ``paper``
is section 3 without our additions, ``novel`` adds a task to a model, ``settling``
learns tasks of few rows again as if they joined, and ``terms`` grows several terms one
after another. ``ranges`` says at which length-scales to begin, and ``periods`` at which
periods. What goes beyond the paper:

- *Relaxed*: a wide penalty on the logarithms of k^x's parameters, at first.
- *Annealed*: the noise variance is held up, at first.
- *Shaken*: from a mode, the noise variance is raised again and all is learned anew.
- Large data are learned *from coarse to fine*, beginning with a few hundred rows, or,
  of complete data, inputs.

``agreement`` ends climbs that lead nowhere new. ``hidden`` finds functions that were
taken for noise, ``faster`` looks for fast ones early, and ``exchanging`` for better
features where there is no noise. ``forecast`` and ``telling`` say how long it takes and
how far it is, ``ambiguity`` and ``neighbours`` what a mode leaves in doubt,
``transformed`` which scale of the targets is likelier, and ``lines`` whether curves may
be straight. ``separate`` and ``own_kernels`` say whether a model of each task, or two
kernels, would be likelier, ``common_function`` whether tasks share one more function,
and ``row_effects`` whether rows have effects of their own.

``penalised`` adds weak priors, ``sampling`` draws hyperparameters, ``evidence``
integrates them out, ``laplace`` has what rows leave open around a mode, and
``open_rows`` whose rows of F are open.
``shortlisting`` learns the best of several forms, which ``contenders`` and ``weighing``
compare, and goes ``further`` to higher ranks; ``vanishing`` finds numbers of a diagonal
that do not count. ``identifying`` finds which task some samples are of.
"""
