"""The order of the examples in the gallery, which docs/conf.py asks for."""

from pathlib import Path

ORDER = [
    "plot_task_prediction",
    "plot_robot_loads",
    "plot_five_loads",
    "plot_sites",
    "plot_task_covariance",
    "plot_transfer",
    "plot_joint_states",
    "plot_trajectory",
    "plot_novel_load",
    "plot_negative_correlation",
    "plot_choose_rank",
    "plot_grid_search",
    "plot_calibration",
    "plot_sampled",
    "plot_real_data",
    "plot_when_not",
    "plot_complete_data",
    "plot_large_data",
    "plot_inducing_inputs",
]


def position(script):
    """Where a script, a name or path, stands."""
    return ORDER.index(Path(script).stem)
