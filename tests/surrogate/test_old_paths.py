"""Modules by the names that they had before the learner had two storeys."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec

import pytest

from surrogate.old_paths import MOVED, NAMES, new_path


def test_every_new_place_is_there() -> None:
    assert all(find_spec(new) is not None for new in MOVED.values())


def test_a_room_is_the_same_by_both_names() -> None:
    with pytest.warns(DeprecationWarning, match="'surrogate.touch' is 'surrogate.mechanics.touch'"):
        old = import_module("surrogate.touch")
    new = import_module("surrogate.mechanics.touch")
    assert old is new
    assert old.__spec__ is not None
    assert old.__spec__.name == "surrogate.mechanics.touch"


def test_a_module_is_the_same_by_both_names() -> None:
    with pytest.warns(DeprecationWarning, match="goes in 1.1"):
        from surrogate.data.geometry import Geometry  # type: ignore[import-not-found]
    from surrogate.mechanics.body import geometry

    assert Geometry is geometry.Geometry
    assert sys.modules["surrogate.data.geometry"] is geometry


def test_other_names_are_as_they_were() -> None:
    assert new_path("surrogate.mechanics.solids") is None
    assert new_path("surrogate.database") is None
    with pytest.raises(ModuleNotFoundError, match="No module"):
        import_module("surrogate.fly")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize(("room", "place", "names"), NAMES)
def test_rooms_have_the_names_that_they_had(room: str, place: str, names: str) -> None:
    old, new = import_module(f"surrogate.{room}"), import_module(f"surrogate.{place}")
    for name in names.split():
        assert getattr(old, name) is getattr(new, name)
    with pytest.raises(AttributeError, match="has no attribute 'fly'"):
        old.fly  # noqa: B018
