"""The paper's settings, section 6: what is measured, and what a whole result has."""

JOINTS = (1, 2, 3, 4, 5, 6)
ALL_LOADS = tuple(range(1, 16))  # of Table 2
LOADS = tuple(range(1, 15))  # of the multi-task experiments
NEW_LOAD = 15
TEST_SETS = ("interpolation", "extrapolation")
DRAWS = (0, 1, 2)

TABLE2_SIZES = (20, 170, 1004, 4000)  # samples of each load
TABLE2_JOINT = 3  # the only one printed, and at the largest size the only one measured

SIZES = (280, 476, 532, 896, 1820, 2800)  # samples of all 14 loads
LARGE = 600  # one draw above
RANKS = (2, 4, 5, 6, 8, 10)
LARGEST = 2800  # fewer ranks from here on
RANKS_OF_LARGEST = (4, 5, 6)

SMALL_N = 280
SMALL_RANKS = (4, 5)
LEARNERS = ("staged", "simultaneous", "annealed")

NEW_SAMPLES = (1, 2, 5, 10, 20, 50)
NOVEL_RANKS = (4, 5, 6)


def in_table2(joint, size):
    """Whether Table 2 is to have this joint at so many samples of a load."""
    return joint == TABLE2_JOINT or size < max(TABLE2_SIZES)


def draws_of(n, draws=DRAWS):
    """Draws at this n: all of the small ones, the first of the large ones."""
    return tuple(draws) if n < LARGE else tuple(draws)[:1]


def ranks_of(n, ranks=RANKS):
    """Ranks that are compared at this n."""
    if n < LARGEST:
        return tuple(ranks)
    return tuple(r for r in ranks if r in RANKS_OF_LARGEST) or tuple(ranks)
