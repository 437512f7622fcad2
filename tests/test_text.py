"""What comes from outside is shown without doing anything, and read as a number only where it is one."""

import pytest

from auv_torchrl.text import in_order, number, printable, whole, within


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("ArduSub V4.5.0 \x1b[31mred", r"ArduSub V4.5.0 \x1b[31mred"),
        ("a\nSERVO1_FUNCTION,0\r", r"a\nSERVO1_FUNCTION,0\r"),
        ("\x9b2J\x7f\x00", r"\x9b2J\x7f\x00"),
        ("dive\u202egol.BIN\u2066", r"dive\u202egol.BIN\u2066"),
        ("a\u200bb\ufeff\u2028c", r"a\u200bb\ufeff\u2028c"),
        ("caf\udce9.csv \ud83d", r"caf\xe9.csv \ud83d"),
        ("\U000e0041", r"\U000e0041"),
        ("Flüge 深度\u202f№ 3 <b>", "Flüge 深度\u202f№ 3 <b>"),
    ],
)
def test_what_is_no_character_to_look_at_is_spelt_out(given, shown):
    """Controls, direction marks, separators and lone surrogates are spelt; letters, signs and spaces stay."""
    assert printable(given) == shown
    assert printable(printable(given)) == shown
    shown.encode()


def test_a_text_without_end_is_cut_and_its_length_said():
    """Of a million characters as many are shown as fit into 200 with their number; None shows all."""
    long = printable("x" * 1_000_000)
    assert len(long) == 200 and long.endswith("xxx… (1,000,000 characters)") and printable(long) == long
    spelt = printable("\x1b" * 150)
    assert len(spelt) == 200 and spelt.endswith("… (150 characters)") and printable(spelt) == spelt
    assert len(printable("x" * 1000, None)) == 1000


@pytest.mark.parametrize(
    "text", ["1_0", "١٢", "１", "", "-", "1e", "0x10", "1,5", "one", "1 2", "²", "infinit", "--1", "1" * 20 + "_0"]
)
def test_only_ascii_digits_are_a_number(text):
    """Digits of other scripts, underscores and commas are none, though Python would take some."""
    assert number(text) is None and whole(text) is None


def test_numbers_are_read_as_they_are_written():
    """Signs, exponents, nan, and a number of 400 digits, which is infinite as float64 has it."""
    assert [number(text) for text in (" 1.5\n", "-.5", "+3.e2", "1E-3")] == [1.5, -0.5, 300.0, 1e-3]
    assert number("9" * 400) == float("inf") and number("NaN") != number("NaN") and number("-inf") == -float("inf")
    assert [whole(text) for text in ("-12", "007", "1.0", "9" * 19)] == [-12, 7, None, None]


def test_of_a_long_text_the_middle_is_left_out():
    """Its beginning and its end stay, and it says how long it was; a short text stays as it is."""
    shown = within("cause " + "x" * 5000 + ": remedy", 100)
    assert len(shown) == 100 and shown.startswith("cause xxx") and shown.endswith("xxx: remedy")
    assert " … (5,014 characters) … " in shown and within("x" * 100, 100) == "x" * 100


def test_names_are_put_in_the_order_in_which_people_count():
    """Part 2 comes before part 10; digits such as ² are letters, and a number may have thousands."""
    names = ["part10.db3", "part2.db3", "part².db3", "part" + "9" * 5000, "²", "1²3", "", "part02", "part"]
    assert [name[:10] for name in sorted(names, key=in_order)] == [
        "", "1²3", "part", "part02", "part2.db3", "part10.db3", "part999999", "part².db3", "²",
    ]  # fmt: skip
