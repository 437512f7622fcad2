"""How often commands change and how finely a motion is followed between."""

CONTROL_DT = 0.05  # s; explicit Euler on Table 1 at 2 m/s is stable only below 0.04 s, RK4 at half this step is
SUBSTEPS = 4  # RK4 steps per control step. 2 are 9 to 60 mm off after starts at 2 m/s (4: below 1 mm), and diverge
# where randomization makes the vehicle lighter and its drag larger
