"""One client of a server: requests as JSON, replies, and the state of its body in between.

A request is an object with a key ``do``, whose value is one of `REQUESTS`; everything else is
optional but what the table names. The reply repeats an ``id``, a text or a number, if there is one.
A reply to a wrong request, or of a search that fails or takes too long, has the keys ``error`` and
``kind`` ("input" or "work"). A request names no file: meshes have the names of those that the
server was started with.

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
``step``      ``seconds``; ``density`` in kg/m³ and ``damping`` of     displacement, velocity, time,
              the first one; ``load``, ``body_force``, ``tool``,       error, reaction
              ``held``, ``actuate``: numbers by names
``let_go``                                                             displacement
``control``   ``measured``, ``target``; first ``markers``, and         given, places, missed, …
              ``loads``, ``within``, ``rates``, ``period``
============  =======================================================  ============================

``fields: false`` leaves out the displacement; ``nodes: "surface"`` gives that of the surface alone,
in the order of ``surface`` of ``mesh``.
"""

from __future__ import annotations

import json
import logging
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_schema.common.bodies.command_loads import CommandLoads
from shared_schema.common.configuration import validate
from shared_schema.common.errors import InputError, WorkError
from shared_schema.motion import Damping
from shared_schema.tools import Mesh, Tool, parse_tool
from surrogate.learning.inference.surrogate import Surrogate
from surrogate.mechanics.actuation.controller import Controller
from surrogate.mechanics.motion.session import Session
from surrogate.mechanics.statics.load import Load, given_load
from surrogate.mechanics.touch import Grip, Touch
from surrogate.runtime.time_limit import OutOfTimeError, TimeLimit
from surrogate.serving import control_requests

Array = NDArray[np.float64]
Message = Mapping[str, Any]
logger = logging.getLogger(__name__)
KEYS = {
    "mesh": set[str](),
    "load": {"load", "body_force"},
    "push": {"tool", "load", "body_force"},
    "feel": {"tool"},
    "hold": {"held", "load", "body_force"},
    "step": {"seconds", "density", "damping", "load", "body_force", "tool", "held", "actuate"},
    "let_go": set[str](),
    "control": control_requests.KEYS,
}
REQUESTS = tuple(KEYS)
ALWAYS = {"do", "id", "fields", "nodes"}
MOST = 64  # places of a grip, and loads
LONGEST = 1000  # letters of an error, and of an id
SMALL = 1e-3  # of the body's extents


class Client:
    """Requests of one client.

    Parameters
    ----------
    model : Surrogate
        It may be shared by clients.
    meshes : mapping of str to Mesh, optional
        Tools by the names that requests have for them.
    seconds : float
        That a request may take.
    """

    def __init__(
        self, model: Surrogate, meshes: Mapping[str, Mesh] | None = None, seconds: float = inf
    ) -> None:
        self._model, self._meshes = model, meshes or {}
        self._limit = TimeLimit(seconds)
        self._touch: Touch | None = None
        self._grips: dict[tuple[str, ...], Grip] = {}
        self._controller: Controller | None = None
        self._moving: Session | None = None

    def answer(self, text: str | bytes) -> str:
        """Reply to a request; whatever it is, there is a reply."""
        found: dict[str, Any] = {}
        try:
            message = read_message(text)
            found |= {"id": message["id"]} if "id" in message else {}
            with self._limit.running():
                reply = self._handlers[message["do"]](message)
            return json.dumps(found | reply, allow_nan=False)
        except InputError as error:
            found |= {"error": str(error)[:LONGEST], "kind": "input"}
        except WorkError as error:
            found |= {"error": str(error)[:LONGEST], "kind": "work"}
        except OutOfTimeError:
            self._begin_at_rest()
            said = f"took more than {self._limit.seconds:g} s; the body is at rest again"
            found |= {"error": said, "kind": "work"}
        except Exception:  # a client must not end the server
            logger.error("a request failed: %.200r\n%s", text, traceback.format_exc())
            found |= {"error": "the request failed, the server's log says why", "kind": "bug"}
        return json.dumps(found, allow_nan=False)

    def stop(self) -> None:
        """End the present request and all that follow, from any thread."""
        self._limit.stop()

    @property
    def _handlers(self) -> dict[str, Callable[[Message], dict[str, Any]]]:
        return {
            "mesh": self._mesh,
            "load": self._load,
            "push": self._push,
            "feel": self._feel,
            "hold": self._hold,
            "step": self._step,
            "let_go": self._let_go,
            "control": self._control,
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
        frame = self._touch.move(self._tool(message), self._given(message))
        found = {
            "reaction": frame.reaction.tolist(),
            "touched": frame.nodes,
            "penetration": frame.penetration,
        }
        return found | self._field(message, frame.displacement)

    def _feel(self, message: Message) -> dict[str, Any]:
        if self._touch is None:
            raise InputError("feel: expected a push before")
        return {"reaction": self._touch.reaction(self._tool(message)).tolist()}

    def _hold(self, message: Message) -> dict[str, Any]:
        held = self._held(message)
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

    def _step(self, message: Message) -> dict[str, Any]:
        if self._moving is None:
            given: dict[str, Any] = {}
            if "density" in message:
                given["density"] = _number(message, "density")
            if "damping" in message:
                given["damping"] = validate(Damping, message["damping"], "damping")
            self._moving = Session(self._model, **given)
        elif not {"density", "damping"}.isdisjoint(message):
            raise InputError("density, damping: expected in the first step alone")
        actuate = message.get("actuate", {})
        if not isinstance(actuate, dict) or not all(map(is_number, actuate.values())):
            raise InputError("actuate: expected an object of names and numbers")
        frame = self._moving.step(
            _number(message, "seconds"),
            Load.of(self._model.geometry, self._load_of(message), actuate=actuate),
            tool=self._tool(message) if "tool" in message else None,
            held=self._held(message) if "held" in message else None,
        )
        found: dict[str, Any] = {"time": frame.time, "error": frame.error}
        found["reaction"] = frame.reaction.tolist()
        if message.get("fields", True) is not False:
            found["velocity"] = self._field(message, frame.velocity)["displacement"]
        return found | self._field(message, frame.displacement)

    def _let_go(self, message: Message) -> dict[str, Any]:
        self._begin_at_rest()
        return self._field(message, np.zeros(self._model.geometry.coordinates.shape))

    def _control(self, message: Message) -> dict[str, Any]:
        if self._controller is None or control_requests.SETTING & set(message):
            self._controller = control_requests.controller_of(message, self._model.actuation)
        d = self._model.geometry.dimension
        frame = control_requests.controlled(message, self._controller, d)
        return control_requests.reply_of(frame) | self._field(message, frame.displacement)

    def _begin_at_rest(self) -> None:
        self._touch, self._grips, self._controller, self._moving = None, {}, None, None

    def _held(self, message: Message) -> dict[str, list[float | None]]:
        """Places that are held, and their displacements."""
        held = message.get("held")
        if not isinstance(held, dict) or not 0 < len(held) <= MOST:
            raise InputError(f"held: expected an object of 1 to {MOST} places and displacements")
        d = self._model.geometry.dimension
        for place, moved in held.items():
            if not isinstance(moved, list) or len(moved) != d:
                raise InputError(f"held: '{place}': expected {d} numbers or null")
            if not all(part is None or is_number(part) for part in moved):
                raise InputError(f"held: '{place}': expected {d} numbers or null")
        return held

    def _tool(self, message: Message) -> Tool:
        """The tool of a request."""
        if not isinstance(message.get("tool"), str):
            raise InputError("tool: expected a text")
        return parse_tool(message["tool"], self._model.geometry.dimension, self._meshes)

    def _given(self, message: Message) -> Array:
        """The load beside what is pushed or held, in N."""
        return self._load_of(message).load

    def _load_of(self, message: Message) -> CommandLoads:
        """The same as forces of a command, without pressures."""
        texts, density = message.get("load", []), message.get("body_force")
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            raise InputError("load: expected a list of texts")
        if len(texts) > MOST:
            raise InputError(f"load: expected {MOST} texts at most, found {len(texts)}")
        if density is not None and not (isinstance(density, list) and all(map(is_number, density))):
            raise InputError("body_force: expected a list of numbers")
        given = given_load(self._model.geometry, texts, False, density, needed=False)
        if given.surfaces:
            raise InputError("load: expected forces, no pressure")
        return given

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


def make_first_frame(model: Surrogate) -> None:
    """Hold a node a little aside: what that compiles, or keeps of the body, frames have at once."""
    geometry = model.geometry
    model.predict(np.zeros(geometry.coordinates.shape))
    node = np.flatnonzero(geometry.free.all(axis=1))[-1]
    place = ",".join(repr(float(value)) for value in geometry.coordinates[node])
    aside = SMALL * np.ptp(geometry.coordinates, axis=0)
    with suppress(InputError, WorkError):  # not every body can be held
        Grip(model, [place]).move([aside])


def read_message(text: str | bytes) -> Message:
    """Read a request; InputError if it is none."""
    try:
        message = json.loads(text, parse_constant=_no_number)
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
    name = message.get("id", 0)
    if not (is_number(name) or (isinstance(name, str) and len(name) <= LONGEST)):
        raise InputError(f"id: expected a number, or a text of at most {LONGEST} letters")
    return message


def _number(message: Message, key: str) -> float:
    """A number of a request."""
    value = message.get(key)
    if not is_number(value):
        raise InputError(f"{key}: expected a number")
    return float(value)  # type: ignore[arg-type]


def _no_number(name: str) -> float:
    """Refuse NaN, Infinity and -Infinity, which JSON has not."""
    raise ValueError(name)


def is_number(value: object) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
