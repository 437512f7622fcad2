"""Controllers: soft actor-critic on a fleet, and the classical ones it is compared with."""
