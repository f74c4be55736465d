"""The cases of tests that are parametrized in pairs."""

from itertools import combinations, product

from pairs import covering

CHOICES = "abcdefg", "ABCDE", "12", "xy"


def test_all_pairs_meet():
    cases = covering(*CHOICES)
    for i, j in combinations(range(4), 2):
        met = {(case[i], case[j]) for case in cases}
        assert met == set(product(CHOICES[i], CHOICES[j]))


def test_there_are_few():
    assert len(covering(*CHOICES)) < 40  # of 140
