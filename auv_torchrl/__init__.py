"""Train a controller for an underwater vehicle in simulation, adapt it, and find out why reality differs."""

__version__ = "0.1.0"
