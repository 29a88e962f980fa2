import pytest
from hypothesis import given
from hypothesis import strategies as st

from graindamp.units import STANDARD_GRAVITY, intensity, to_si


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("1.25 mm", "m", 1.25e-3),
        ("40 g", "m/s^2", 40 * STANDARD_GRAVITY),
        ("40g", "m/s^2", 40 * STANDARD_GRAVITY),
        ("350 g", "kg", 0.35),
        ("26 N", "N", 26.0),
        ("2 %", "", 0.02),
        ("55 MPa", "Pa", 55e6),
        ("9930 N m^2", "N m^2", 9930.0),
        ("12 m/s²", "m/s^2", 12.0),
        ("180 deg", "rad", 3.141592653589793),
        ("2.2 N/mm", "N/m", 2200.0),
        ("1.5", "m", 1.5),
        (3, "m", 3.0),
        ("3000 rpm", "Hz", 50.0),
        ("628.3185307179587 rad/s", "Hz", 100.0),
    ],
)
def test_reads_what_people_type(text, unit, value):
    assert to_si(text, unit) == pytest.approx(value, rel=1e-14)  # rounding of one conversion


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("1.25 kg", "m", ["[mass]", "[length]", "1.25 mm"]),
        ("1,25 mm", "m", ["decimal point"]),
        ("3 foo", "m", ["foo", "1.25 mm"]),
        ("long", "m", ["1.25 mm"]),
        ("", "m", ["1.25 mm"]),
        (True, "m", ["1.25 mm"]),
        (None, "m", ["1.25 mm"]),
        (float("nan"), "m", ["finite"]),
        ("inf", "m", ["finite"]),
        ("5 mm", "", ["plain number", "2 %"]),
    ],
)
def test_says_what_is_expected(text, unit, words):
    with pytest.raises(ValueError) as caught:
        to_si(text, unit)
    for word in words:
        assert word in str(caught.value)


@given(
    st.floats(1e-9, 1e9), st.sampled_from([("mm", "m", 1e-3), ("kN", "N", 1e3), ("g", "kg", 1e-3), ("ms", "s", 1e-3)])
)
def test_conversion_is_linear(number, row):
    spelled, unit, factor = row
    assert to_si(f"{number!r} {spelled}", unit) == pytest.approx(number * factor, rel=1e-12)  # rounding


@given(st.text(max_size=20))
def test_any_text_gives_a_number_or_one_clear_error(text):
    message = ""
    try:
        to_si(text, "m")
    except ValueError as error:
        message = str(error)
    assert message == "" or "expected" in message


def test_intensity_is_in_standard_gravity():
    assert intensity(98.0665) == pytest.approx(10.0)
