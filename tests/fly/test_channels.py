"""Commands as messages: what the firmware makes of a message is the command, within its limits."""

import numpy as np
import pytest

from auv_torchrl.fly.channels import CENTRE_US, LEAVE, Channels, Interface, Travel, travel_of

ODD = {3: Travel(1050, 1480, 1950), 4: Travel(1100, 1520, 1900, True)}


def passed(sent, gain, lift=1.0):
    """The pulses that ArduSub makes of a message, by number of the input: its joystick.cpp."""
    told = sent.fields
    if sent.name == "RC_CHANNELS_OVERRIDE":
        return {n: told[f"chan{n}_raw"] for n in range(1, 7)}
    scale = 0.4 * gain
    pulses = {1: 1500, 2: 1500, 3: 1500 + 2 * scale * lift * (told["z"] - 500), 4: 1500 + scale * told["r"],
              5: 1500 + scale * told["x"], 6: 1500 + scale * told["y"]}  # fmt: skip
    return {n: min(1900, max(1100, int(pulse))) for n, pulse in pulses.items()}


def shares(pulses, travels, yaw_gain=3.375):
    """Surge, sway, heave and yaw that its mixer gets in MANUAL."""
    share = {n: travels.get(n, Travel()).share(pulse) for n, pulse in pulses.items()}
    return np.array([share[5], share[6], -share[3], share[4] * yaw_gain / 3.375])


@pytest.mark.parametrize("travels", [{}, ODD], ids=["usual", "odd"])
@pytest.mark.parametrize(("interface", "gain"), [(Interface.RC, 0.5), (Interface.MANUAL, 1.0), (Interface.MANUAL, 0.5)])
def test_the_firmware_gets_the_command(travels, interface, gain):
    """To a pulse of 1 us, at any gain that lets it through; of what is beyond the gain, as much as there is."""
    channels = Channels(interface, travels=travels, yaw_gain=4.0, throttle_gain=0.8)
    for command in np.random.default_rng(0).uniform(-1, 1, (200, 4)):
        sent = channels.sent(command, gain)
        reached = shares(passed(sent, gain, 0.8), travels, 4.0)
        np.testing.assert_allclose(reached, sent.command, atol=1.5 / 350)
        within = np.abs(command) < (0.88 if interface is Interface.RC else 0.3 if gain < 1 else 0.65)
        np.testing.assert_allclose(reached[within], command[within], atol=3 / 350)


@pytest.mark.parametrize("interface", Interface)
def test_neutral_is_neutral_whatever_the_gain(interface):
    """Throttle at 500 or at its trim, and no other input is moved: RC_CHANNELS_OVERRIDE leaves 7 and 8."""
    sent = Channels(interface).sent((0.0,) * 4, 0.3)
    assert set(passed(sent, 0.3).values()) == {CENTRE_US} and not any(sent.command)
    if interface is Interface.MANUAL:
        assert (sent.fields["z"], sent.fields["buttons"]) == (500, 0)
    else:
        assert (sent.fields["chan7_raw"], sent.fields["chan8_raw"]) == (LEAVE, LEAVE)


@pytest.mark.parametrize("interface", Interface)
def test_no_command_leaves_the_ranges_of_the_fields(interface):
    """Whatever is asked for."""
    for command in np.random.default_rng(1).normal(0, 100, (300, 4)):
        told = Channels(interface).sent(command, 0.1).fields
        if interface is Interface.RC:
            assert all(1100 <= told[f"chan{n}_raw"] <= 1900 for n in range(1, 7))
        else:
            assert 0 <= told["z"] <= 1000 and all(-1000 <= told[axis] <= 1000 for axis in "xyr")


def test_a_downward_heave_is_less_throttle_and_a_turn_to_starboard_more_yaw():
    """Our z is down, ArduSub's throttle up."""
    told = Channels(Interface.RC).sent((0.0, 0.0, 0.5, 0.25), 1.0).fields
    assert told["chan3_raw"] == 1300 and told["chan4_raw"] == 1600


def test_travels_that_leave_nothing_on_one_side_are_refused():
    """With what to set."""
    parameters = {"RC3_MIN": 1100.0, "RC3_TRIM": 1100.0, "RC3_MAX": 1900.0, "RC3_REVERSED": 0.0}
    with pytest.raises(ValueError, match="RC3_MIN, _TRIM and _MAX are 1100, 1100 and 1900 us: set them in that order"):
        travel_of(3, parameters)
    assert travel_of(3, {**parameters, "RC3_TRIM": 1500.0}) == Travel()
