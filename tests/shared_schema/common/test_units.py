"""Labels of units, and lengths that can be read at any size."""

from __future__ import annotations

import numpy as np
import pytest

from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError
from shared_schema.common.units import Units


@pytest.mark.parametrize(
    ("length", "force", "stress", "energy"),
    [
        ("m", "N", "Pa", "J"),
        ("mm", "N", "MPa", "mJ"),
        ("mm", "kN", "GPa", "J"),
        ("µm", "µN", "MPa", "µN·µm"),
        ("µm", "nN", "kPa", "nN·µm"),
        ("cm", "N", "N/cm²", "N·cm"),
        ("in", "lbf", "lbf/in²", "lbf·in"),
    ],
)
def test_stresses_are_in_force_over_length_squared(
    length: str, force: str, stress: str, energy: str
) -> None:
    units = Units(length=length, force=force)
    assert (units.stress, units.energy) == (stress, energy)
    assert units.named("Pa") == stress
    assert units.named("s") == "s"


@pytest.mark.parametrize(
    ("unit", "length", "text"),
    [
        ("m", 0.000267, "0.267 mm"),
        ("m", 0.123456, "123 mm"),
        ("m", 0.0, "0 mm"),
        ("m", 1e-6, "0.001 mm"),
        ("m", 9.9e-7, "0.99 µm"),
        ("m", 2.67e-7, "0.267 µm"),
        ("m", 1e-9, "0.001 µm"),
        ("m", 2.67e-10, "0.267 nm"),
        ("m", 1.09e-5, "0.0109 mm"),
        ("m", 3e-11, "0.03 nm"),
        ("m", 0.9, "900 mm"),
        ("m", 36.5, "36.5 m"),
        ("m", 4321.0, "4.32 km"),
        ("m", float("inf"), "inf mm"),
        ("mm", 0.267, "0.267 mm"),
        ("mm", 2.67e-4, "0.267 µm"),
        ("µm", 10.9, "10.9 µm"),
        ("µm", 2.67e-4, "0.267 nm"),
        ("km", 2.67e-4, "0.267 m"),
        ("in", 2.67e-4, "0.000267 in"),
    ],
)
def test_lengths_are_written_in_a_unit_that_fits(unit: str, length: float, text: str) -> None:
    assert Units(length=unit).written(length) == text


def test_cases_without_units_are_in_metres_and_newtons() -> None:
    assert Units.of_case({}) == Units()
    assert Units.of_case({"units": {"length": "mm"}}).force == "N"
    assert Units().labels == {"length": "m", "force": "N", "stress": "Pa", "time": "s"}


@pytest.mark.parametrize("label", ["", "a b", "<b>", "x" * 13, "$m$"])
def test_a_label_is_a_word(label: str) -> None:
    with pytest.raises(InputError, match="length"):
        validate(Units, {"length": label}, "case")


def test_axes_have_a_unit_that_fits_their_largest_length() -> None:
    """Millimetres for metres, up to a kilometre; another unit only where digits would be lost."""
    assert Units().drawn(np.array([0.0, 2.5])) == ("mm", 1e3)
    assert Units().drawn(np.zeros(0), np.zeros(3)) == ("mm", 1e3)
    unit, factor = Units().drawn(np.array([4e-8]), np.array([4e-7]))
    assert unit == "µm"
    assert factor == pytest.approx(1e6)
    assert Units(length="mm").drawn(np.array([0.3])) == ("mm", 1.0)
    assert Units(length="in").drawn(np.array([4e-7])) == ("in", 1.0)
