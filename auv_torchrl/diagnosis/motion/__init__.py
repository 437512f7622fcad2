"""A flight log in short windows that a simulator follows, and the force that it misses there."""
