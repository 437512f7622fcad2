"""What docs/results/other-vehicles.md is measured with: ``control``, ``paths``, and the diagnosis of ``dives``."""
