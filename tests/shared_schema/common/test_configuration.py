"""Configurations: what is read of YAML files, new values of keys, lists of shipped files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field, ValidationError

from shared_schema.common.command_line import laid_out
from shared_schema.common.configuration import (
    Frozen,
    changed,
    one_line,
    read_named,
    read_yaml,
    shipped_files,
    source_of,
    validate,
)
from shared_schema.common.errors import InputError

NESTED: dict[str, Any] = {"a": {"b": 1, "c": 2}, "list": [{"x": 0}, {"y": 1}], "text": "t"}


class Inner(Frozen):
    steps: int = Field(3, ge=1)
    rate: float = 0.5


class Outer(Frozen):
    name: str
    inner: Inner = Inner()
    shape: tuple[int, int] = (1, 2)


def test_valid_content() -> None:
    found = validate(Outer, {"name": "a", "inner": {"steps": 4}}, "a.yaml")
    assert found == Outer(name="a", inner=Inner(steps=4))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"name": "a", "colour": 1}, "a.yaml: unknown key 'colour'"),
        ({"name": "a", "inner": {"colour": 1}}, "a.yaml: unknown key 'inner.colour'"),
        ({}, "a.yaml: key 'name' is missing"),
        ({"name": 3}, "a.yaml: key 'name' = 3: input should be a valid string"),
        (
            {"name": "a", "inner": {"steps": 0}},
            "a.yaml: key 'inner.steps' = 0: input should be greater than or equal to 1",
        ),
        (
            {"name": "a", "inner": {"steps": 1.5}},
            "a.yaml: key 'inner.steps' = 1.5: input should be a valid integer",
        ),
        (
            {"name": "a", "inner": {"rate": float("nan")}},
            "a.yaml: key 'inner.rate' = nan: input should be a finite number",
        ),
        ({"name": "a", "shape": [1]}, "a.yaml: key 'shape.1' is missing"),
        (
            {"name": "a", "inner": {"steps": True}},
            "a.yaml: key 'inner.steps' = True: input should be a valid integer",
        ),
        (
            {"name": "a", "inner": {"steps": "6"}},
            "a.yaml: key 'inner.steps' = '6': input should be a valid integer",
        ),
        (
            {"name": "a", "inner": {"rate": "0.5"}},
            "a.yaml: key 'inner.rate' = '0.5': input should be a valid number",
        ),
        (
            {"name": "a", "shape": [1, False]},
            "a.yaml: key 'shape.1' = False: input should be a valid integer",
        ),
    ],
)
def test_first_problem_in_one_line(content: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        validate(Outer, content, "a.yaml")
    assert str(error.value) == message


@pytest.mark.parametrize("content", [None, 3, "text", ["name"]])
def test_other_than_a_mapping(content: Any) -> None:
    with pytest.raises(InputError, match=r"a\.yaml: key '\(top level\)'") as error:
        validate(Outer, content, "a.yaml")
    assert "\n" not in str(error.value)


def test_whole_numbers_are_floats_and_lists_are_tuples() -> None:
    model = validate(Outer, {"name": "a", "inner": {"rate": 2}, "shape": [3, 4]}, "a.yaml")
    assert (model.inner.rate, model.shape) == (2.0, (3, 4))


def test_models_are_frozen() -> None:
    model = Outer(name="a")
    with pytest.raises(ValidationError, match="frozen"):
        model.name = "b"  # type: ignore[misc]


def test_read_yaml(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("name: a\ninner: {steps: 4}\n")
    assert read_yaml(path) == {"name": "a", "inner": {"steps": 4}}


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (b"a: [1,\nb: 2", "not valid YAML"),
        (b"a: !!python/object:os.system {}", "not valid YAML"),
        (b"a: 2024-13-45", "not valid YAML"),  # a date that there is not
        (b"\xff\xfe\xff", "cannot be read"),
        (b"", "expected a mapping"),
        (b"- a", "expected a mapping"),
        (b"a: 1\nb: 2\na: 3", "key 'a' occurs twice"),
        (b"b: {a: 1, a: 1}", "key 'a' occurs twice"),
        (b"[1, 2]: 4", "a list or a mapping as a key, expected a name"),
        (b"a: {{b: 1}: 4}", "a list or a mapping as a key, expected a name"),
        (b"a: &a [*a]", "a value contains itself"),
        (b"a: " + b"[" * 5000, "not valid YAML"),
        (b"a: " + b"9" * 5000, "not valid YAML"),
        (b"a: b\n" + b"#" * 2**20, "expected at most 1048576 bytes"),
        (b"a: &a [1, 2]\n" + b"b: [" + b"*a, " * 40000 + b"]", "more than 100000 values"),
    ],
)
def test_yaml_that_is_none(tmp_path: Path, text: bytes, part: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=part) as error:
        read_yaml(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def bomb(merge: bool) -> str:
    """Thirty keys, each of which repeats the one before nine times: 9³⁰ values."""
    if merge:
        lines = ["k0: &k0 {a: 1}"]
        lines += [f"k{n}: &k{n} {{<<: [{', '.join([f'*k{n - 1}'] * 9)}]}}" for n in range(1, 30)]
    else:
        lines = ["k0: &k0 [1]"]
        lines += [f"k{n}: &k{n} [{', '.join([f'*k{n - 1}'] * 9)}]" for n in range(1, 30)]
    return "\n".join(lines)


@pytest.mark.timeout(20)
@pytest.mark.parametrize("merge", [True, False])
def test_bombs(tmp_path: Path, merge: bool) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(bomb(merge))
    with pytest.raises(InputError, match="more than 100000 values, with those that aliases repeat"):
        read_yaml(path)


def test_aliases_and_merge_keys_of_a_sensible_size(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: &a {x: 1, y: 2}\nb: {<<: *a, y: 3}\nc: [*a, *a]\n")
    plain = {"x": 1, "y": 2}
    assert read_yaml(path) == {"a": plain, "b": {"x": 1, "y": 3}, "c": [plain, plain]}


@pytest.mark.parametrize(
    ("text", "number"),
    [
        *[("1e-3", 1e-3), ("-2.5E+4", -2.5e4), (".5e1", 5.0), ("1e3", 1e3)],
        *[("0500", 500), ("-015", -15), ("00", 0), ("0_100", 100), ("0x10", 16)],
        *[("8:20", "8:20"), ("1:30.5", "1:30.5")],
    ],
)
def test_numbers_as_people_write_them(tmp_path: Path, text: str, number: float | str) -> None:
    """PyYAML follows YAML 1.1, where 1e-3 is a text, 0500 is 320 and 8:20 is 500."""
    path = tmp_path / "a.yaml"
    path.write_text(f"a: {text}\nb: '{text}'")
    assert read_yaml(path) == {"a": number, "b": text}


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.yaml: no such file"):
        read_yaml(tmp_path / "a.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_yaml(tmp_path)


def test_a_misspelt_required_key_is_named() -> None:
    """What is missing is what the unknown key beside it is meant to be."""

    class Outer(Frozen):
        supports: int

    with pytest.raises(InputError) as found:
        validate(Outer, {"suports": 1}, "a.yaml")
    assert str(found.value) == "a.yaml: unknown key 'suports', expected 'supports'"
    with pytest.raises(InputError, match="key 'supports' is missing"):
        validate(Outer, {"other": 1}, "a.yaml")


class Block(Frozen):
    kind: Literal["block"]
    size: float


class FromFile(Frozen):
    kind: Literal["file"]
    file: str
    size: float = 1.0


class Part(Frozen):
    mesh: Annotated[Block | FromFile, Field(discriminator="kind")]


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        ({"kind": "block", "size": "2"}, "key 'mesh.size' = '2': input should be a valid number"),
        ({"kind": "block"}, "key 'mesh.size' is missing"),
        ({"kind": "block", "sise": 2}, "unknown key 'mesh.sise', expected 'size'"),
        ({"kind": "file"}, "key 'mesh.file' is missing"),
        ({"kind": "file", "file": 3}, "key 'mesh.file' = 3: input should be a valid string"),
        (
            {"kind": "file", "file": "file", "size": "2"},
            "key 'mesh.size' = '2': input should be a valid number",
        ),
    ],
)
def test_kinds_are_no_part_of_a_key(mesh: Any, message: str) -> None:
    """A key is named as in the file, where the kind of a mesh is a value."""
    with pytest.raises(InputError) as found:
        validate(Part, {"mesh": mesh}, "a.yaml")
    assert str(found.value) == f"a.yaml: {message}"


@pytest.fixture
def shipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of shipped files with beam.yaml; the working directory is another, empty one."""
    shipped, here = tmp_path / "shipped", tmp_path / "here"
    shipped.mkdir()
    here.mkdir()
    (shipped / "beam.yaml").write_text("name: shipped\n")
    monkeypatch.chdir(here)
    return shipped


def test_a_file_here_of_a_shipped_name_is_refused(shipped: Path) -> None:
    """Either may be meant; the message says how to name each."""
    Path("beam").write_text("name: mine\n")
    with pytest.raises(InputError) as found:
        read_named("beam", shipped, "case")
    assert str(found.value) == (
        "case 'beam': a file of this name lies here and one is shipped, "
        f"expected './beam' or '{shipped / 'beam.yaml'}'"
    )
    assert read_named("./beam", shipped, "case")[0] == {"name": "mine"}
    assert read_named(str(shipped / "beam.yaml"), shipped, "case")[0] == {"name": "shipped"}


def test_the_shipped_file_is_read_beside_a_yaml_file_here(
    shipped: Path, caplog: pytest.LogCaptureFixture
) -> None:
    Path("beam.yaml").write_text("name: mine\n")
    assert read_named("beam", shipped, "case")[0] == {"name": "shipped"}
    said = "case 'beam': the shipped one is read; the file here is './beam.yaml'"
    assert caplog.messages == [said]
    assert read_named("beam.yaml", shipped, "case")[0] == {"name": "mine"}
    assert caplog.messages == [said]


def test_in_their_own_folder_shipped_files_are_those_here(
    shipped: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(shipped)
    assert read_named("beam", shipped, "case")[0] == {"name": "shipped"}
    assert not caplog.messages


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ("a.b=3", {"a": {"b": 3, "c": 2}}),
        ("a.b=1e-3", {"a": {"b": 1e-3, "c": 2}}),
        ("a.b=", {"a": {"b": None, "c": 2}}),
        ("a={d: [1, 2]}", {"a": {"d": [1, 2]}}),
        ("new.key=true", {"new": {"key": True}}),
        ('list.1.y="> 0"', {"list": [{"x": 0}, {"y": "> 0"}]}),
        ("text=a=b", {"text": "a=b"}),
    ],
)
def test_one_key(change: str, expected: dict[str, Any]) -> None:
    assert changed(NESTED, [change]) == {**NESTED, **expected}
    assert NESTED["a"]["b"] == 1


def test_the_last_change_of_a_key_counts() -> None:
    assert changed(NESTED, ["a.b=3", "a.c=4", "a.b=5"])["a"] == {"b": 5, "c": 4}


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("a.b", "expected KEY=VALUE"),
        ("=3", "expected KEY=VALUE"),
        ("a..b=3", "expected KEY=VALUE"),
        ("a.b=[1", "not valid YAML"),
        ("a.b=!!python/name:os.system", "not valid YAML"),
        ("text.b=3", "key 'text.b': 'text' = 't' has no parts"),
        ("list.2.x=3", "key 'list.2': expected a number from 0 to 1 after 'list'"),
        ("list.x=3", "key 'list.x': expected a number from 0 to 1 after 'list'"),
    ],
)
def test_wrong_changes(change: str, part: str) -> None:
    with pytest.raises(InputError) as error:
        changed(NESTED, [change])
    assert str(error.value).startswith(f"--set '{change}': ")
    assert part in str(error.value)


def test_source_says_what_was_changed() -> None:
    assert source_of("a.yaml", []) == "a.yaml"
    assert source_of("a.yaml", ["b=1", "c=2"]) == "a.yaml --set b=1 --set c=2"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("# A beam.\nname: a\n", "A beam"),
        ("# A beam (Smith et al. 2022, Fig. 3) with\n# holes. In m.\nname: a", "A beam with holes"),
        ("# Any load: more of it\n# a: b\n", "Any load"),
        ("# A beam; of 3.5 m.", "A beam"),
        ("# No end\nname: a # not this", "No end"),
        ("name: a\n# later\n", ""),
    ],
)
def test_line_of_a_file(text: str, expected: str) -> None:
    assert one_line(text) == expected


def test_files_are_sorted_by_name(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / f"{name}.yaml").write_text(f"# Is {name}.\nname: {name}\n")
    assert list(shipped_files(tmp_path)) == [
        ("a", {"name": "a"}, "Is a"),
        ("b", {"name": "b"}, "Is b"),
    ]


def test_columns_are_aligned() -> None:
    assert laid_out([("a", "bb"), ("ccc", "")]) == "a    bb\nccc"
