"""Healthy flights are held against each other."""

from dataclasses import replace

import numpy as np
import pytest

from auv_torchrl.diagnosis.calibrate.calibration import calibrate, leave_out
from auv_torchrl.diagnosis.command.calibrate_job import flight_lines, no_better_lines, refusal
from auv_torchrl.diagnosis.identify.hypotheses import load_settings
from auv_torchrl.diagnosis.validate.healthy_flights import (
    FlightCheck,
    calibrate_without_odd_flights,
    find_odd_flight,
    flights_disagree,
    pool_errors,
    reason_against,
)
from auv_torchrl.diagnosis.verdict import Errors
from tests.diagnosis.healthy_flights import FAULT, FILE, flown

SETTINGS = load_settings()
ONE_BAD = {"a": None, "bad": FAULT, "b": None}


def unseen(excess, before=50.0, after=5.0, others=1.0):
    return FlightCheck("flight", excess, others, before, after, (2.0,), None, None, None)


@pytest.mark.thorough
def test_one_bad_flight_of_three_is_found_and_the_rest_is_used():
    """A thruster that lost 40 % in one flight does not become part of the vehicle."""
    flights = [flown(name, fault, seed, seconds=10.0) for seed, (name, fault) in enumerate(ONE_BAD.items())]
    done = []
    sound, left, out = calibrate_without_odd_flights(flights, FILE, SETTINGS, report=done.append)
    assert [flight.name for flight in out] == ["bad"]
    assert [flight.name for flight in left] == ["a", "b"]
    assert sound.prior.flights == len(left)
    assert not sound.has_gap
    assert all(flight.excess < SETTINGS.excess and flight.after < 0.5 * flight.before for flight in left)
    assert not reason_against(left)
    assert done == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.thorough
def test_a_flight_is_left_out_of_a_calibration_as_if_it_had_not_been_there():
    """From all flights less what one told, the vehicle is that which the others show by themselves, within error."""
    flights = [flown(name, None, seed, seconds=10.0) for seed, name in enumerate("abc")]
    everything = calibrate(flights, FILE, SETTINGS)
    without = leave_out(everything, flights, 2, SETTINGS)
    alone = calibrate(flights[:2], FILE, SETTINGS)
    assert without is not None
    assert without.prior.flights == 2
    own, anew = ({entry[:2]: entry[2:] for entry in c.estimate.nuisance.entries} for c in (without, alone))
    shared = own.keys() & anew.keys()
    assert len(shared) > 20
    apart = np.array([(own[key][0] - anew[key][0]) / anew[key][1] for key in shared])
    assert np.sqrt((apart**2).mean()) < 1.0
    assert without.excess < SETTINGS.excess
    assert without.prior.floor == pytest.approx(alone.prior.floor, rel=0.5)


@pytest.mark.parametrize(
    ("excess", "odd"),
    [
        ((1.0, 1.1, 1.05), None),
        ((1.0, 8.0, 1.1), 1),
        ((float("inf"), 1.0, 1.1), 0),
        ((1.6, 1.8, 1.7), None),  # nobody fits nobody: the vehicle is not known, but no flight stands out
        ((1.0, 8.0), None),  # of two, nobody knows which
        ((8.0, 9.0), None),
    ],
)
def test_a_flight_is_odd_if_it_stands_out_among_three_or_more(excess, odd):
    """By its chi-square under what the others say."""
    flights = [unseen(one) for one in excess]
    assert find_odd_flight(flights, SETTINGS) == odd
    assert flights_disagree(flights, SETTINGS) == (excess == (8.0, 9.0))


def test_a_flight_is_odd_if_the_others_agree_without_it():
    """Though a sound flight fits a calibration on the fault worse than the fault fits the sound ones."""
    flights = [unseen(0.9, others=3.5), unseen(31.0, others=1.2), unseen(990.0, others=4.4)]
    assert find_odd_flight(flights, SETTINGS) == 1
    assert (
        find_odd_flight([unseen(31.0, others=4.4), unseen(31.0, others=4.0), unseen(40.0, others=4.4)], SETTINGS)
        is None
    )


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (50.0, 5.0, ""),
        (50.0, 49.0, "no better"),
        (5.0, 50.0, "no better"),
        (1.05, 0.9, "as well as the sensors allow"),
        (50.0, float("inf"), "flies off"),
        (float("inf"), float("inf"), "both fly off"),
    ],
)
def test_what_predicts_no_better_is_not_worth_keeping(before, after, words):
    """The reason says how far both are off."""
    said = reason_against([unseen(1.0, before, after)])
    assert words in said and bool(said) == bool(words)


def test_errors_of_flights_are_pooled_by_their_squares():
    """A long error is not averaged away."""
    flights = [unseen(1.0, 3.0, 0.0), replace(unseen(1.0), before=4.0, after=0.0)]
    assert pool_errors(flights) == pytest.approx((12.5**0.5, 0.0))


def test_a_flight_that_gains_nothing_from_the_others_is_named():
    """Where flights gain on the whole, one that the file predicts as well is named; where none gains, none is."""
    good, same, lost = unseen(1.0), unseen(1.0, 10.0, 9.9), unseen(1.0, 10.0, np.nan)
    near = unseen(1.0, 0.5, 0.6)  # within what sensors allow there is nothing to gain
    assert no_better_lines([good, near]) == []
    (line,) = no_better_lines([good, same])
    assert "predicted no better than by the file (9.90 floors of error, 10.00 before)" in line
    assert len(no_better_lines([good, same, same])) == 2
    assert no_better_lines([same, same]) == []
    assert no_better_lines([good, lost]) == [], "nothing is kept: the refusal says what to do"


def test_a_refusal_says_what_to_do_once():
    """Go on with the vehicle as it was; and where some flights gain, until there are more like those that do not."""
    good, lost = unseen(1.0), replace(unseen(1.0, 10.0, np.nan), name="deep.csv")
    assert refusal("both fly off", "paper", [lost]) == "both fly off; nothing was written: go on with vehicle=paper"
    said = refusal("it flies off", "paper", [good, lost])
    assert "go on with vehicle=paper until there are more flights like deep.csv" in said


def test_errors_of_a_flight_are_told_as_before_and_after():
    """With an arrow, as by a diagnosis: "0.123 to 0.0035" would be a range."""
    flown = replace(unseen(1.0), horizons_s=(2.0,), position_m=Errors((0.123,), (0.0035,), (0.002,)))
    (line,) = flight_lines([flown])
    assert line.endswith("position 12.3 cm → 3.50 mm at 2 s")
