"""What docs/results/benchmarks.md is measured with."""

import os

os.environ.setdefault("RL_LOGGING_LEVEL", "WARNING")  # else TorchRL announces every storage on stdout, in our tables
