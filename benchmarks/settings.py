"""The paper's settings, with which the benchmarks of its model stay comparable."""

PAPER = {"task_levels": False, "normalize_y": "shared", "noise": "shared"}
