"""What the parameters say, beside what the flight shows."""

from dataclasses import replace

from auv_torchrl.diagnosis.conclude.findings import configured, set_wrong, to_change, with_configuration
from auv_torchrl.diagnosis.report.files import write_files
from auv_torchrl.diagnosis.report.page import report_page
from auv_torchrl.diagnosis.report.wording import to_do
from auv_torchrl.diagnosis.verdict import Verdict, from_json, to_json
from auv_torchrl.flightlog import Finding, FlightLog, Severity
from auv_torchrl.vehicle import load_vehicle
from tests.diagnosis.example import example, no_gap

SOUND = FlightLog("sound", (), (), autopilot={"MOT_4_DIRECTION": 1.0, "MOT_5_DIRECTION": 1.0, "AHRS_ORIENTATION": 0.0})
WRONG = replace(SOUND, autopilot={**SOUND.autopilot, "MOT_4_DIRECTION": -1.0})
FAULT = Finding(
    Severity.WARNING, "motor_direction", "MOT_4_DIRECTION is -1", "Set it to 1", param=(("MOT_4_DIRECTION", 1),)
)


def test_a_direction_that_the_flight_contradicts_is_not_set_back():
    """A flight without a gap shows that the motor turns as it should: its wires were exchanged, too."""
    (finding,) = configured(WRONG, [SOUND], Verdict.NO_GAP, ())
    assert (
        finding.severity is Severity.INFO
        and not finding.param
        and "wires or plugs were changed, too" in finding.sentence
    )
    (kept,) = configured(WRONG, [SOUND], Verdict.UNEXPLAINED, ())
    assert kept.param == (("MOT_4_DIRECTION", 1.0),)


def test_a_direction_that_the_flight_confirms_is_told_once():
    """The effect's advice says it already."""
    effects = example().effects
    (finding,) = configured(WRONG, [SOUND], Verdict.EXPLAINED, effects)
    assert finding.severity is Severity.WARNING and not set_wrong([finding], effects)
    assert with_configuration("It is so.", [finding], effects) == "It is so."


def test_what_no_flight_shows_is_told_with_the_verdict(tmp_path):
    """A fault of the configuration stands in the summary, in what to do, on the page, and in advice.param."""
    diagnosis = replace(no_gap(), findings=(FAULT,), summary=with_configuration("No gap.", [FAULT], ()))
    assert diagnosis.summary == "No gap. Set wrong, say the parameters: MOT_4_DIRECTION is -1."
    assert to_do(diagnosis) == ["Set it to 1."] and from_json(to_json(diagnosis)).findings == (FAULT,)
    page = report_page(diagnosis, load_vehicle("paper"))
    assert 'id="configuration"' in page and "MOT_4_DIRECTION,1" in page
    write_files(diagnosis, load_vehicle("paper"), tmp_path)
    assert (tmp_path / "advice.param").read_text() == "MOT_4_DIRECTION,1\n"


def test_parameters_are_written_where_they_are_the_remedy_and_nowhere_else(tmp_path):
    """Those of the advice about effects, too."""
    assert to_change(example()) == {"MOT_4_DIRECTION": 1.0}
    write_files(no_gap(), load_vehicle("paper"), tmp_path)
    assert not (tmp_path / "advice.param").exists()
