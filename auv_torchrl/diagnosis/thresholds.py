"""The thresholds that several parts of the diagnosis share, or that ``benchmarks.blind.ablation`` varies.

Within this file a name has one meaning, each with its reason. What a single file needs, as the rounds of its own fit,
stands in that file as a constant of its own; two files may use the same name for different things.

Units: chi-square and log evidence are natural; "per number" is per measured number, of which noise alone leaves 1.
"""

from statistics import NormalDist

import numpy as np

# What the simulator and the sensors may be wrong by
WIDE_SHARE = 0.6  # of the full thrust in a degree of freedom: prior of the force while a wrong model follows the log
FELT_ALONE = 0.1  # of that prior, where a force is felt and no motion measured: a wider one lets the speed be anything
NOISIER = 1.3  # times the noise of the healthy log, from which its noise says nothing about this log
REPEATS = 0.003  # relative, how well a sound vehicle repeats itself from day to day
# Likewise where a wrong file was mended: its numbers take up what the model lacks, in each flight anew.
MENDED_REPEATS = 0.02
# Of what a fault does, by which the model of that fault may be wrong: no chart of a thruster is better, and the wake of
# one that turns backwards is not modelled.
FAULT_KNOWN = 0.02
MODEL_ERROR = 0.001  # of an effect's size: sampling, integration and rounding, which the noise does not cover
LEAST_NOISE = 1e-6  # m, rad, m/s, rad/s: the last digit that logs hold
LEAST_FREEDOM = 0.15  # share of the numbers that a force must leave over to tell the noise from them

# What the samples of a log can carry
MAX_WINDOWS = 180  # 6 minutes of windows of 2 s: what a value is unsure by is then the model's error, not the noise
STEEP = 1.2  # rad of pitch, from which small errors of the attitude are large ones of roll and yaw: three times
FLICKERS = 2.0  # times the thrust at the edge of the dead band, below which a thruster comes and goes
# Of what a change of a command within a grid step makes, not in proportion to it: a short push at one end of a step
# of 0.05 s is, at the other end, a third less than the same push spread over the step, for a vehicle that answers in
# 0.04 s.
BENT = 0.3

# Calibration
HUBER = 2.5  # standard deviations from which a sample counts less: one corrupted row must not turn the fit
FLEW_OFF = 30.0  # standard deviations at which a sample of a vehicle that flew off is cut
SHOWS_DRAG_S = 2.0  # s, below which a window shows no drag
SURELY_BETTER = 2.0  # standard errors by which unseen windows must be predicted better
WORTH_A_CORRECTION = 0.05  # of the error on unseen windows that must go
DIFFERS = 2.0  # standard deviations from which a coefficient is said to differ,
MOVED = 0.25  # where it moved by this share of its uncertainty, too
Z95 = 1.96  # standard deviations, 97.5 % quantile of a normal distribution: half of a 95 % interval
NOTICED = 0.15  # relative difference of speed or time that a pilot would notice
NOTICED_DRIFT = 0.01  # m/s, likewise
NOTICED_TURN = 0.05  # rad/s, likewise
# Of the variance of what a file has wrong about each thruster, the part that all share: volts and the scale of commands
# make 0.35, the wake on the frame 0.2 for each by itself.
SHARED_BY_THRUSTERS = 0.75
DIFFER_BY = 0.15  # of the mean of the others, standard deviation: by what sound thrusters of one vehicle differ
FEWEST_OF_FAMILY = 3  # members of a family of which one can stand out from the others
# Chi-square per number that half of the windows of healthy flights leave where these are fitted as one: trims of 0.5 N
# and currents of 5 cm/s that differ make 2 to 8, files that are wrong by 30 % make 30 to 200.
BEYOND_TRIM = 10.0
# m and rad within 2 s, by which sound sensors of position and velocity, or attitude and rate, do not part ways: 3 % of
# scale at 1 m/s and 2 degrees of heading make 0.07. And the share of stretches of a flight that may all the same.
CONTRADICTED, FEW_CONTRADICTED = 0.1, 0.05
STRAYS = 5.0  # standard deviations, of file and logs, from which a coefficient is not the file's
# Over healthy flights, with a level vehicle and with one that tilts. After one pass, before coefficients have settled,
# log odds were wrong by 588 and by 1445; after two right by 157 and 18.
TILT_PASSES = 2

# Where the gap is
LEAST_PREDICTED = 0.1  # of the gap that forces must predict together, or nothing is said
SAME_COMMANDS = 0.03  # relative, of what two thrusters predict that get the same commands
WORTHLESS = 0.005  # of the gap
STANDS_OUT = 1.3  # gap in a regime, in gaps of the whole log
FEWEST_IN_REGIME = 5  # windows
NOTHING_TO_MAP = 1.05  # chi-square per number below which there is nothing to map

# Held-out flight
WITHIN_FLOOR = 1.1  # an error below this many floors leaves nothing to close
WORSE = 1.05  # times the error
CLOSED_IF_EXPLAINED = 0.9  # share of the gap that must be closed at least where the gap is explained ...
STILL_FAR = 2.0  # ... unless what is left is smaller than this many floors

# What an explanation leaves
MINOR = 0.5  # of the force that nuisance parameters make: an effect below it is no finding
STRAINED = 2.5  # standard deviations of nuisance parameters, beyond which it may stand in for an effect
SATISFIED = 2.0  # standard deviations of chi-square above its mean, below which nothing more is looked for

# Windows that are followed, and those that are not
FOLLOWED = 1.15  # misfit of a window that a free force follows
LOST = 1.6  # misfit of one that it does not, ...
LEAVES_LITTLE = 0.1  # ... unless that is less than this share of the misfit without a force: 1 % of chi-square
MOSTLY_LOST = 0.5  # share of lost windows above which an explanation is simply wrong
FEW_LOST = 0.1  # share of lost or diverged windows below which each is an accident
OUTLIER = 5.0  # standard deviations from which a sample counts less: of noise alone, one in a million does,
MANY_OUTLIERS = 0.2  # if less than this share of a window is so: else it is the window that was not followed
DIVERGED = 1e5  # chi-square of a window in which the vehicle flies off
STUCK = 1.5  # chi-square per number of a window that has not found its start
LOST_START = 4.0  # times the median chi-square of a window: it has lost its start, whatever the vehicle
SETTLING = 2  # steps of the free numbers where windows begin; a small change of the vehicle needs one
HEIRS = 3  # rounds in which starts are handed on from window to window

# Sensors that contradict each other
TRIED_WINDOWS = 5  # windows: contradicting sensors do so all the time
AGREES_AS_WELL = 1.25  # times the least misfit: as far off as values between those of a scan are, near the right one
AGREES_BETTER = 0.7  # of the misfit of the vehicle as it is, that a change must get below

# Roll and pitch
SMALL_SWING = 0.05  # rad of roll and pitch below which they are taken as held

# Priors
SECOND_EFFECT = 0.02  # prior probability of one more effect once there is one: two faults in one log are rare
ONE_MORE_VALUE = 0.1  # prior probability that one more parameter of an effect is away from its nominal value
PRIOR_NUMBERS = 10.0  # forces that the stated floor counts for, against those that the healthy log determines
TILTS = 0.5  # of the tilt that the thrusters can hold against the restoring moment: prior of roll and pitch
REACH_WIDTH = 1.0  # prior standard deviation of each force that locates the gap, in shares of the thrusters' reach
RANGE_CAP = {"m": 6.0, "N/m": 60.0, "N": 60.0}  # plausible widths where the bounds of a parameter only exclude nonsense

# Fitting: slopes and nuisance parameters
NUISANCE_SHARES = np.geomspace(1.0, 0.05, 13)  # of its width, that nuisance parameters may have in one vehicle
# Of the plausible range of a parameter. Where a tether comes taut, a slope over a long step is wrong in the few samples
# between, and that is much of what tells two values apart that nearly make up for each other. But thrust that leaves a
# dead band jumps, and of such jumps a short step meets none.
SHORT_STEP = 0.0004
LONG_STEP = 0.004  # likewise, of nuisance parameters and of what changes thrust
NUISANCE_LIMIT = (
    4.0  # standard deviations of a nuisance parameter: more is a gap; one vehicle in twenty has one beyond 3
)
NUISANCE_STEP = 0.05  # relative step of derivatives by nuisance parameters
TELLS = 1.0  # chi-square of one standard deviation of a nuisance parameter, below which it keeps ...
UNTOLD = 0.03  # ... this share of its width
# Of the deviation that healthy flights leave of a scale of the vehicle, what a log that tells it leaves at most: a fit
# is drawn to small scales by up to one deviation, because a disturbance is in newtons.
TELLS_SCALES = 0.5
NOISE_MATTERS = 0.02  # relative change of the sensor noise from which explanations are weighed again
RELINEARISED = 3  # times at most that windows are linearised again
GAINS_AGAIN = 0.02  # of chi-square, below which that is not worth it
SETTLED_ALONG = 0.02  # of chi-square: a fit along the motion that gains less is done
STUCK_ALONG = 1e-6  # of chi-square: a fit along the motion that loses no more went nowhere

# Fitting: values that are tried one by one
THRESHOLD_REACH = (0.05, 0.015, 0.004)  # of the plausible range
TRIED_STEPS = np.linspace(-1.0, 1.0, 9)  # of each reach
SETTLED_TRIALS = 3  # of those that are tried, the likeliest
WALKS = 3  # at most, along a valley
NUISANCE_REACH = 2.0  # standard deviations, within which thresholds are tried, ...
NUISANCE_NEAR = 0.4  # ... and then about the best of these

# Screening by responses
ELASTIC_WIDTH = 0.4  # a scanned value may act by 1 +- 0.4 of itself, then a neighbour takes over
SAME_RESPONSE = 0.9995  # cosine between two responses, nuisance parameters, start and disturbance fitted
FIXED_WIDTH = 1e-5  # a discrete change acts wholly
SEEN_AT_ALL = 1e-6  # chi-square of a whole candidate
MOST_TERMS = 6  # of one family

# Several effects along the measured motion
NEAR = 1.5  # chi-square per number above which an explanation is missing something
# An unknown effect is not to be pieced together from many known ones.
CLOSES = 0.15  # of the chi-square beyond noise that one more effect must close

# What is simulated
SIMULATED = 4  # neighbours that are simulated in a round
FITTED_FROM = 3  # places at most, from which one explanation is fitted, where each promises more than the fits before,
SETTLED = 1.0  # by this log evidence
# Log evidence by which the linear prediction of an explanation may be too low, and share of the log likelihood that is
# missing: where much is left, slopes hold less far.
DOUBTED, DOUBTED_SHARE = 5.0, 0.1
FITTED_ALONG = 8  # of which values are fitted along the measured motion first
FAR_BEHIND = 2.0  # times the least chi-square of a search: a fit that is beyond it after a round is left at that
CONTENDS = 100.0  # log evidence that a fit that leaves nothing may still be away from its best
FITTED_ON = 3  # times at most, of rivals, while each gains ...
STILL_GAINS = 1.0  # ... this log evidence, times the chi-square per number that it leaves
HOPELESS = 0.5  # of what no effect leaves: one effect that leaves less makes it needless to fit no effect
# Most of the work is to look for effects, and two minutes of flight show which ones act. Logs of the recommended two to
# three minutes have up to 90 windows, and all of these are searched. Of more than MANY_WINDOWS, some that are spread
# evenly over the log are searched, and what is found there is fitted to all.
MANY_WINDOWS = 120
SEARCHED_WINDOWS = 60
REFITTED = 2  # rivals that are fitted to all windows beside the best

# Adding and taking out effects
WORTH_AN_EFFECT = 5.0  # log evidence that one more effect must bring

# A moment at which the vehicle changes
BLOCK_S = 0.6  # s over which the missing force is averaged
FEWEST_BLOCKS = 10  # on either side of an onset
ONSET_CLEAR = 40.0  # log likelihood that two levels of the missing force must gain over one
LARGER = 20.0  # times the energy before the onset, in some degree of freedom, and not of thrusts and motion, too
FEWEST_WINDOWS = 4  # behind an onset, to be explained by themselves
SPEAKS = 10.0  # chi-square by which the windows before an onset must fit better without the effect

# What is told
HORIZONS_S = (0.5, 1.0, 2.0, 5.0)  # s behind a start, at which errors are told: from a reflex to a manoeuvre
SURE = 0.9  # probability above which an effect is told as a fact: one of ten at most is wrong then
LIKELY = 0.5  # likewise, at which it may as well be untrue: never a fact, and nobody takes apart what is likelier sound

# What a log cannot tell
# Chi-square by which an explanation may be worse: 99.73 % quantile of one value
NOT_EXCLUDED = NormalDist().inv_cdf(1 - 0.0027 / 2) ** 2
STANDS_IN = 0.6  # probability that a known effect found beside an unknown one only stands in for it
SHOWS = 30.0  # chi-square that pays for an effect and its place
FOLLOWS = 3  # steps of the motion that nobody measured
LITTLE = 3 * SHOWS  # chi-square of the smallest size that is tried; some of it is motion that has not settled yet
FAINT = 0.25  # of the chi-square that a response promises: where a vehicle makes less of it, there is no such response
