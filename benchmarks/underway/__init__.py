"""What docs/results/other-vehicles.md is measured with: ``control`` at speed, then the diagnosis of ``dives``."""
