"""Maximising the marginal likelihood."""

from skmtgp.learning.climbing import Data, Settings
from skmtgp.learning.ranks import learn_ranks
from skmtgp.learning.stages import first_stage, learn_fixed, second_stage

__all__ = [
    "Data",
    "Settings",
    "first_stage",
    "learn_fixed",
    "learn_ranks",
    "second_stage",
]
