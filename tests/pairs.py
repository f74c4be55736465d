"""Cases in which every two values of two arguments meet, instead of all cases."""

from itertools import combinations, product

import pytest


def in_pairs(*indirect, **values):
    """Parametrize a test: `values` has a dict of names and values for each argument.

    Code that takes, say, kernels and forms of K^rho apart fails for some pair of them
    where it fails at all: the fourfold product finds no more than the pairs. Arguments
    named first go to fixtures of that name.
    """
    cases = [
        pytest.param(
            *(
                values[argument][name]
                for argument, name in zip(values, case, strict=True)
            ),
            id="-".join(case),
        )
        for case in covering(*values.values())
    ]
    return pytest.mark.parametrize(list(values), cases, indirect=list(indirect))


def covering(*choices):
    """Few members of the product of the choices, in which all pairs meet."""
    members = {case: pairs_of(case) for case in product(*choices)}
    missing, found = set().union(*members.values()), []
    while missing:
        found.append(max(members, key=lambda case: len(members[case] & missing)))
        missing -= members[found[-1]]
    return found


def pairs_of(case):
    """Pairs of places and of what is chosen there."""
    return set(combinations(enumerate(case), 2))
