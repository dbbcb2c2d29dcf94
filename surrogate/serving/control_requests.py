"""Requests to control a body: markers in, what is given of its actuators out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError
from surrogate.mechanics.actuation.actuation import Actuation
from surrogate.mechanics.actuation.controller import ControlFrame, Controller

Array = NDArray[np.float64]
Message = Mapping[str, Any]
SETTING = {"markers", "loads", "within", "rates", "period"}
KEYS = {"target", "measured"} | SETTING
MOST, LARGEST = 1024, 1e300  # markers, and numbers


def controller_of(message: Message, actuation: Actuation) -> Controller:
    """The controller that a first request asks for; InputError if it is wrong."""
    target, within = _target(message), message.get("within", {})
    markers = _points("markers", message.get("markers"), actuation.body.geometry.dimension)
    loads, rates = message.get("loads", []), message.get("rates", {})
    if not isinstance(loads, list) or not all(isinstance(text, str) for text in loads):
        raise InputError("loads: expected a list of texts")
    if not isinstance(within, dict) or not all(_is_row(each, 2) for each in within.values()):
        raise InputError("within: expected an object of actuators and two numbers each")
    if not isinstance(rates, dict) or not _is_row(list(rates.values()), len(rates)):
        raise InputError("rates: expected an object of actuators and numbers")
    limits = {name: (float(low), float(high)) for name, (low, high) in within.items()}
    period = {"period": message["period"]} if "period" in message else {}
    return Controller(
        actuation,
        markers=markers,
        target=list(target),
        loads=loads,
        within=limits,
        rates=rates,
        **period,
    )


def controlled(message: Message, controller: Controller, d: int) -> ControlFrame:
    """The next frame of a controller; places without a marker are null."""
    target, measured = _target(message), message.get("measured")
    if tuple(target) != controller.targets:
        named = ", ".join(controller.targets)
        raise InputError(f"target: expected those of the first request, {named}")
    seen = None if measured is None else _points("measured", measured, d)
    return controller.step(seen, _points("target", list(target.values()), d))


def reply_of(frame: ControlFrame) -> dict[str, Any]:
    """All of a frame but the displacement."""
    return {
        "given": frame.given,
        "places": frame.places.tolist(),
        "missed": frame.missed,
        "stiffness": frame.stiffness,
        "loads": list(frame.loads),
        "unseen": frame.unseen,
        "warning": frame.warning,
    }


def _target(message: Message) -> dict[str, Any]:
    target = message.get("target")
    if not isinstance(target, dict) or not target:
        raise InputError("target: expected an object of places and points")
    return target


def _points(name: str, rows: object, d: int) -> Array:
    """Points, (n, d) in m; NaN of null."""
    if not isinstance(rows, list) or not 0 < len(rows) <= MOST:
        raise InputError(f"{name}: expected a list of 1 to {MOST} points")
    if not all(row is None or _is_row(row, d) for row in rows):
        raise InputError(f"{name}: expected points of {d} numbers, or null")
    return np.array([[np.nan] * d if row is None else row for row in rows], dtype=np.float64)


def _is_row(row: object, count: int) -> bool:
    """Whether something is a list of so many finite numbers."""
    if not isinstance(row, list) or len(row) != count:
        return False
    return all(isinstance(x, int | float) and abs(x) < LARGEST for x in row)
