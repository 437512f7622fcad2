"""The benchmark over many dives: how early a fading thruster is noticed, and how often a sound vehicle is accused."""
