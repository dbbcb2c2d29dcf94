"""One client of a server: requests as JSON, replies, and the state of its body in between.

A request is an object with a key ``do``, whose value is one of `REQUESTS`; everything else is
optional but what the table names. The reply repeats an ``id``, if there is one. A reply to a wrong
request, or of a search that fails, has the keys ``error`` and ``kind`` ("input" or "work").

============  =======================================================  ============================
``do``        keys                                                     reply
============  =======================================================  ============================
``mesh``                                                               coordinates, cells, facets
``load``      ``load``: texts as ``--load`` takes them,                displacement
              ``body_force``
``push``      ``tool``: a text as ``--tool`` takes it; ``load``,       displacement, reaction,
              ``body_force``                                           nodes, penetration
``feel``      ``tool``, close to that of the last ``push``             reaction
``hold``      ``held``: places and displacements, null where free;     displacement, reactions
              ``load``, ``body_force``
``let_go``                                                             displacement
============  =======================================================  ============================

``fields: false`` leaves out the displacement; ``nodes: "surface"`` gives that of the surface alone,
in the order of ``surface`` of ``mesh``.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.errors import InputError, WorkError
from shared_schema.tools import parse_tool
from surrogate.inference.given_load import given_load
from surrogate.inference.surrogate import Surrogate
from surrogate.touch import Grip, Touch

Array = NDArray[np.float64]
Message = Mapping[str, Any]
logger = logging.getLogger(__name__)
KEYS = {
    "mesh": set[str](),
    "load": {"load", "body_force"},
    "push": {"tool", "load", "body_force"},
    "feel": {"tool"},
    "hold": {"held", "load", "body_force"},
    "let_go": set[str](),
}
REQUESTS = tuple(KEYS)
ALWAYS = {"do", "id", "fields", "nodes"}
MOST_PLACES = 64


class Session:
    """Requests of one client.

    Parameters
    ----------
    model : Surrogate
        It may be shared by sessions.
    """

    def __init__(self, model: Surrogate) -> None:
        self._model = model
        self._touch: Touch | None = None
        self._grips: dict[tuple[str, ...], Grip] = {}

    def answer(self, text: str | bytes) -> str:
        """Reply to a request; whatever it is, there is a reply."""
        found: dict[str, Any] = {}
        try:
            message = read_message(text)
            if "id" in message:
                found["id"] = message["id"]
            found |= self._handlers[message["do"]](message)
        except InputError as error:
            found |= {"error": str(error), "kind": "input"}
        except WorkError as error:
            found |= {"error": str(error), "kind": "work"}
        except Exception:  # a client must not end the server
            logger.exception("a request failed: %.200r", text)
            found |= {"error": "the request failed, the server's log says why", "kind": "bug"}
        return json.dumps(found, allow_nan=False)

    @property
    def _handlers(self) -> dict[str, Callable[[Message], dict[str, Any]]]:
        return {
            "mesh": self._mesh,
            "load": self._load,
            "push": self._push,
            "feel": self._feel,
            "hold": self._hold,
            "let_go": self._let_go,
        }

    def _mesh(self, message: Message) -> dict[str, Any]:
        geometry = self._model.geometry
        return {
            "case": self._model.description.run.case,
            "length": geometry.units.length,
            "force": geometry.units.force,
            "coordinates": geometry.coordinates.tolist(),
            "cells": geometry.cells.tolist(),
            "cell_type": geometry.cell_type,
            "facets": geometry.surface_facets.tolist(),
            "surface": geometry.surface_nodes.tolist(),
        }

    def _load(self, message: Message) -> dict[str, Any]:
        return self._field(message, np.asarray(self._model.predict(self._given(message))))

    def _push(self, message: Message) -> dict[str, Any]:
        if self._touch is None:
            self._touch = Touch(self._model)
        tool = parse_tool(text_of(message, "tool"), self._model.geometry.dimension)
        frame = self._touch.move(tool, self._given(message))
        found = {
            "reaction": frame.reaction.tolist(),
            "touched": frame.nodes,
            "penetration": frame.penetration,
        }
        return found | self._field(message, frame.displacement)

    def _feel(self, message: Message) -> dict[str, Any]:
        if self._touch is None:
            raise InputError("feel: expected a push before")
        tool = parse_tool(text_of(message, "tool"), self._model.geometry.dimension)
        return {"reaction": self._touch.reaction(tool).tolist()}

    def _hold(self, message: Message) -> dict[str, Any]:
        held = message.get("held")
        if not isinstance(held, dict) or not 0 < len(held) <= MOST_PLACES:
            raise InputError(
                f"held: expected an object of 1 to {MOST_PLACES} places and displacements"
            )
        d = self._model.geometry.dimension
        for place, moved in held.items():
            if not isinstance(moved, list) or len(moved) != d:
                raise InputError(f"held: '{place}': expected {d} numbers or null")
            if not all(part is None or is_number(part) for part in moved):
                raise InputError(f"held: '{place}': expected {d} numbers or null")
        key = tuple(
            f"{place}:{','.join('-' if part is None else '0' for part in moved)}"
            for place, moved in held.items()
        )
        if key not in self._grips:
            self._grips = {key: Grip(self._model, list(key))}  # other places: from rest
        moves = [[part or 0.0 for part in moved] for moved in held.values()]
        frame = self._grips[key].move(moves, self._given(message))
        found = {"reactions": frame.reactions.tolist()}
        return found | self._field(message, frame.displacement)

    def _let_go(self, message: Message) -> dict[str, Any]:
        self._touch, self._grips = None, {}
        return self._field(message, np.zeros(self._model.geometry.coordinates.shape))

    def _given(self, message: Message) -> Array:
        """The load beside what is pushed or held, (n_nodes, d) in N."""
        texts, density = message.get("load", []), message.get("body_force")
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            raise InputError("load: expected a list of texts")
        if density is not None and not (isinstance(density, list) and all(map(is_number, density))):
            raise InputError("body_force: expected a list of numbers")
        given = given_load(self._model.geometry, texts, False, density, needed=False)
        if given.surfaces:
            raise InputError("load: expected forces, no pressure")
        return given.forces

    def _field(self, message: Message, displacement: Array) -> dict[str, Any]:
        if message.get("fields", True) is False:
            return {}
        where = message.get("nodes", "all")
        if where not in ("all", "surface"):
            raise InputError('nodes: expected "all" or "surface"')
        if where == "surface":
            displacement = displacement[self._model.geometry.surface_nodes]
        if not np.isfinite(displacement).all():
            raise WorkError("the predicted displacement is not finite")
        return {"displacement": displacement.tolist()}


def read_message(text: str | bytes) -> Message:
    """Read a request; InputError if it is none."""
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("expected JSON") from None
    if not isinstance(message, dict):
        raise InputError("expected a JSON object")
    what = message.get("do")
    if not isinstance(what, str) or what not in KEYS:
        raise InputError(f"do: expected one of {', '.join(REQUESTS)}")
    unknown = set(message) - ALWAYS - KEYS[what]
    if unknown:
        raise InputError(f"{what}: unknown key '{min(unknown)}'")
    return message


def text_of(message: Message, key: str) -> str:
    """The text of a key; InputError if it has none."""
    if not isinstance(message.get(key), str):
        raise InputError(f"{key}: expected a text")
    return str(message[key])


def is_number(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
