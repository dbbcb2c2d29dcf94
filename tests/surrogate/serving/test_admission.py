"""Who may connect: RFC 6455's headers, names of this machine, pages from elsewhere."""

from __future__ import annotations

import pytest

from shared_schema.common.errors import InputError
from surrogate.serving.admission import Admission

LISTED = Admission.of(["Lab-PC.example.org"], ["https://Viewer.example.org:8443", "null"])
HERE = "127.0.0.1"


@pytest.mark.parametrize(
    "host",
    ["localhost", "localhost:8765", "LOCALHOST:1", "127.0.0.1:8765", "[::1]:8765", "[::1]"],
)
@pytest.mark.parametrize(
    "origin",
    [None, "http://localhost", "http://localhost:3000", "https://127.0.0.1:1", "http://[::1]:80"],
)
def test_programs_and_pages_of_this_machine_are_let_in(host: str, origin: str | None) -> None:
    assert Admission().refusal([host], [origin] if origin else [], HERE) is None


@pytest.mark.parametrize(
    "origin",
    [
        *("null", "", "*", "file://", "http://example.org", "https://viewer.example.org:8443"),
        *(
            "http://localhost.example.org",
            "http://localhost@example.org",
            "http://127.0.0.1.nip.io",
        ),
        *("http://localhost:80@example.org", "http://localhost:1/", "http://example.org#localhost"),
        *(
            "http://127.0.0.2",
            "http://0.0.0.0",
            "ftp://localhost",
            "http://localhost ",
            "localhost",
        ),
        *("http://localhost:80.example.org", "http://localhost\nhttp://example.org"),
    ],
)
def test_pages_from_elsewhere_are_refused(origin: str) -> None:
    said = Admission().refusal(["localhost:8765"], [origin], HERE)
    assert said is not None
    assert said.startswith("Origin: expected a page of a server on localhost")


@pytest.mark.parametrize(
    "hosts",
    [
        *([], ["localhost", "localhost"], [""], ["example.org"], ["example.org:8765"], ["0.0.0.0"]),
        *(["localhost.example.org"], ["localhost."], ["localhost@example.org"], ["localhost:x"]),
        *(["127.0.0.1.nip.io:8765"], ["10.0.0.7"], ["[::2]"], ["::1"], ["lab-pc.example.org"]),
    ],
)
def test_other_names_of_this_machine_are_refused(hosts: list[str]) -> None:
    """As a page's own name, rebound to this machine, would be."""
    said = Admission().refusal(hosts, [], HERE)
    assert said is not None
    assert said.startswith("Host: expected localhost, the server's address, or a name given")


def test_listed_names_and_origins_are_let_in() -> None:
    for origin in ("https://viewer.example.org:8443", "null", "http://localhost"):
        assert LISTED.refusal(["lab-pc.example.org:8765"], [origin], "10.0.0.7") is None
    assert LISTED.refusal(["10.0.0.7:8765"], [], "10.0.0.7") is None
    assert LISTED.refusal(["[fe80::7]:8765"], [], "fe80::7") is None
    both = ["null", "http://localhost"]
    for origins in (["https://viewer.example.org"], ["http://viewer.example.org:8443"], both):
        assert LISTED.refusal(["localhost"], origins, HERE) is not None


@pytest.mark.parametrize(
    ("names", "origins", "said"),
    [
        (["lab pc"], [], "name lab pc: expected the name of a machine, without a port"),
        (["lab-pc:80"], [], "name lab-pc:80: expected the name"),
        ([""], [], "name : expected the name"),
        (
            [],
            ["example.org"],
            "origin example.org: expected one such as https://example.org:8080",
        ),
        ([], ["https://example.org/page"], "expected one such as"),
        ([], ["*"], r"origin \*: expected one such as"),
    ],
)
def test_what_is_no_name_or_origin(names: list[str], origins: list[str], said: str) -> None:
    with pytest.raises(InputError, match=said):
        Admission.of(names, origins)
