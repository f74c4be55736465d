import numpy as np
import pandas as pd
import pytest

from skmtgp import RankSearchIC, make_inverse_dynamics_regressor
from skmtgp._data.joints import check_order
from skmtgp.datasets import load_puma560
from skmtgp.preprocessing import InverseDynamicsFeatures

BLOCKS = ["q1", "q2", "qd1", "qd2", "qdd1", "qdd2"]


@pytest.mark.parametrize(
    "names",
    [
        BLOCKS,
        ["q2", "q1", "qd2", "qd1", "qdd2", "qdd1"],
        ["joint1_pos", "joint2_pos", "vel_1", "vel_2", "acc1", "acc2"],
        ["a", "q1", "b", "qd1", "c", "qdd1"],  # says too little
        ["q1", "qd1", "qdd1", "q1"],
        ["q", "qd", "qdd"],
        range(6),
    ],
)
def test_orders_that_are_taken(names):
    """Those that are right, and those that names do not tell."""
    check_order(list(names))


@pytest.mark.parametrize(
    ("names", "first"),
    [
        (["q1", "qd1", "qdd1", "q2", "qd2", "qdd2"], "q1', 'q2', 'qd1"),
        (["pos 1", "vel 1", "acc 1", "pos 2", "vel 2", "acc 2"], "pos 1', 'pos 2"),
        (["qd1", "qd2", "q1", "q2", "qdd1", "qdd2"], "q1', 'q2', 'qd1"),
        (["q1", "q2", "dq2", "dq1", "ddq1", "ddq2"], "q1', 'q2', 'dq1', 'dq2"),
        (BLOCKS[::-1], "q2', 'q1', 'qd2"),
    ],
)
def test_orders_that_are_refused(names, first):
    with pytest.raises(ValueError, match=rf"must have the positions .*X\[\['{first}"):
        check_order(names)


def test_frames_of_a_robot():
    """An interleaved frame was learned without a word."""
    puma = load_puma560(n_per_load=3, loads=[1, 2], as_frame=True)
    joints = [[f"q{j}", f"qd{j}", f"qdd{j}"] for j in range(1, 7)]
    interleaved = puma.data[[*np.ravel(joints), "load"]]
    with pytest.raises(ValueError, match="must have the positions of all joints first"):
        InverseDynamicsFeatures().fit(interleaved)
    model = make_inverse_dynamics_regressor(RankSearchIC(ranks=(1,)))
    with pytest.raises(ValueError, match="must have the positions of all joints first"):
        model.fit(interleaved, puma.target["tau2"])
    load_first = pd.concat(
        [puma.data[["load"]], puma.data.drop(columns="load")], axis=1
    )
    InverseDynamicsFeatures(task_feature="load").fit(load_first)
