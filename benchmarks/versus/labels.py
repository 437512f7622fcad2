"""The first cells of the rows of the tables; without mujoco.sysid, which not every machine has."""

SHARES = {"single": 9.0, "pair": 4.0, "no_gap": 3.0, "outside": 4.0}  # of the families, out of 20
FAMILIES = tuple(SHARES)
ASKED = ("single", "pair", "no_gap")  # families that a fit can be right about
ALL = "all of these"
NOT_ASKED = "outside: not called explained"
ERROR, ERROR_90 = "error of the true numbers, median", "… 90th percentile of them"
HELD = "95 % intervals that hold the truth"
MOVED, MOST = "sound numbers moved by more than 5 %, median of a log", "… most in a log"
FREE = "numbers that are free"
BEFORE, AFTER, AFTER_90 = "held-out flight before, m at 2 s, median", "… after, median", "… after, 90th percentile"
SECONDS, LONGEST = "CPU s of a log, median", "… largest"
FIGURES = (ERROR, ERROR_90, HELD, MOVED, MOST, FREE, BEFORE, AFTER, AFTER_90, SECONDS, LONGEST)
