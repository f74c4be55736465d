"""What the experiments share: plan, data, models, the files of results, the runner."""
