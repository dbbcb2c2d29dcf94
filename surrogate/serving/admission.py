"""Who may connect: the headers ``Host`` and ``Origin`` of a request (RFC 6455, Sections 4.2, 10.2).

A browser lets a page from anywhere open a WebSocket to this machine, and says in ``Origin`` where
the page is from. Pages of this machine's own servers are let in, others if they are listed.
Programs other than browsers send no origin; they are let in. A page that is a file has the origin
``null``, as has a frame with which any page can hide its own: it is let in only if it is listed.

A page can also give this machine a name of its own by DNS, and is then of the same origin as the
server (DNS rebinding). The name stands in ``Host``, which has to be the address that the connection
was made to, a name of the loopback interface, or a listed one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from shared_schema.common.errors import InputError

LOOPBACK = ("localhost", "127.0.0.1", "[::1]")
HOST = r"(?:[a-z0-9._-]+|\[[0-9a-f:.]+\])"
PORT = r"(?::[0-9]{1,5})?"
OF_LOOPBACK = re.compile(rf"https?://(?:{'|'.join(map(re.escape, LOOPBACK))}){PORT}")


@dataclass(frozen=True)
class Admission:
    """What a request to connect may say.

    Attributes
    ----------
    names : frozenset of str
        Names of this machine beside those of the loopback interface, in lower case.
    origins : frozenset of str
        Origins of pages beside those of servers on this machine, in lower case.
    """

    names: frozenset[str] = frozenset()
    origins: frozenset[str] = frozenset()

    @classmethod
    def of(cls, names: Iterable[str], origins: Iterable[str]) -> Admission:
        """Read names and origins; InputError if one is none."""
        names, origins = ([text.lower() for text in texts] for texts in (names, origins))
        for name in names:
            if not re.fullmatch(HOST, name):
                raise InputError(
                    f"name {name}: expected the name of a machine, without a port", "name"
                )
        for origin in origins:
            if origin != "null" and not re.fullmatch(rf"[a-z][a-z0-9+.-]*://{HOST}{PORT}", origin):
                raise InputError(
                    f"origin {origin}: expected one such as https://example.org:8080, or null",
                    "origin",
                )
        return cls(frozenset(names), frozenset(origins))

    def refusal(self, hosts: Sequence[str], origins: Sequence[str], address: str) -> str | None:
        """Say why a request is refused; None if it is not.

        Parameters
        ----------
        hosts, origins : sequence of str
            Values of its headers ``Host`` and ``Origin``.
        address : str
            Address of this machine that the connection was made to.
        """
        at = f"[{address}]" if ":" in address else address
        name = re.fullmatch(rf"({HOST}){PORT}", hosts[0].lower()) if len(hosts) == 1 else None
        if name is None or name[1] not in {*LOOPBACK, at, *self.names}:
            return "Host: expected localhost, the server's address, or a name given by --name"
        if not origins:
            return None
        origin = origins[0].lower()
        if len(origins) == 1 and (origin in self.origins or OF_LOOPBACK.fullmatch(origin)):
            return None
        return "Origin: expected a page of a server on localhost, or one given by --origin"
