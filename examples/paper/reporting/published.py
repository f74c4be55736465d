"""Numbers that the paper prints, section 6."""

# Table 2, joint 3. Of the row of LR no more can be read than its first number.
TABLE2 = {
    ("LR", "interpolation"): {20: 1e-1},
    ("LR", "extrapolation"): {},
    ("sGP", "interpolation"): {20: 1e-2, 170: 2e-7, 1004: 2e-8, 4000: 3e-9},
    ("sGP", "extrapolation"): {20: 1e-1, 170: 3e-2, 1004: 4e-3, 4000: 3e-3},
}
RANKS = {280: 4, 476: 5, 532: 4, 896: 4, 1820: 5, 2800: 4}


def start(n, joint):
    """The model with the higher likelihood, where mGP begins."""
    return "pGP" if joint == 1 and n < 532 else "iGP"
