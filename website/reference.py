"""Pages of the reference made from the programs: arguments of their commands, keys of their YAML.

Each program's pages are made in its own environment: ``python -m website.reference datagen``. They
are in the repository, so that they can be read there.
"""

from __future__ import annotations

import argparse
import os
import sys
from importlib import import_module
from pathlib import Path

from website.key_tables import keys_page

PRINTED = (
    "`datagen schema` prints this list, and with `--format json` a JSON Schema for editors, which "
    "complete and check keys with it."
)
OUT = Path(__file__).parents[1] / "docs" / "reference"


def commands_page(program: str) -> str:
    """Describe every command of a program: what it does, its usage and its arguments."""
    parser = import_module(f"{program}.command_line")._parser()
    lines = [f"# Commands of `{program}`", "", f"{parser.description} {parser.epilog}"]
    for name, command in commands_of(parser).items():
        lines += ["", f"## {program} {name}", "", command.description or "", ""]
        lines += ["```text", command.format_usage().removeprefix("usage: ").rstrip(), "```", ""]
        lines += ["| argument | meaning |", "|---|---|"]
        lines += [
            f"| {_named(action)} | {_meaning(action)} |"
            for action in command._actions
            if not isinstance(action, argparse._HelpAction)
        ]
        if command.epilog:
            examples = [line.strip() for line in command.epilog.splitlines()[1:]]
            lines += ["", "```sh", *examples, "```"]
    return "\n".join(lines) + "\n"


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of all commands by name."""
    (action,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return dict(action.choices)


def _named(action: argparse.Action) -> str:
    value = action.metavar or ("" if action.nargs == 0 else (action.dest or "").upper())
    if action.choices is not None and not action.metavar:
        value = "|".join(str(choice) for choice in action.choices)
    words = f"{action.option_strings[-1]} {value}" if action.option_strings else str(value)
    return f"`{_cell(words.strip())}`"


def _meaning(action: argparse.Action) -> str:
    text = _sentence(action.help or "")
    unsaid = action.default in (None, False, "", [], float("inf"), argparse.SUPPRESS)
    if not unsaid and "default" not in text:
        text = f"{text} Default: `{action.default}`.".strip()
    return _cell(f"{text} Required.".strip() if action.required and action.option_strings else text)


def _sentence(text: str) -> str:
    text = text.strip()
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith('.') else '.'}" if text else ""


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", r"\|")


def pages_of(program: str) -> dict[str, str]:
    """Return the pages of a program by file name."""
    commands = {f"{program}-commands.md": commands_page(program)}
    if program == "datagen":
        from datagen.cases.case_schema import case_keys

        intro = "A case is a YAML file with these keys; `datagen` refuses any other."
        title = "Keys of a case"
        return commands | {"case-keys.md": keys_page(title, f"{intro} {PRINTED}", case_keys())}
    from surrogate.learning.runs.config_reader import config_keys

    intro = (
        "A configuration is a YAML file with these keys. Its keys `model` and `likelihood` choose "
        "the kind of model; `surrogate` refuses keys that this kind does not read."
    )
    title = "Keys of a configuration"
    page = keys_page(title, f"{intro} {PRINTED.replace('datagen', program)}", config_keys())
    return commands | {"configuration-keys.md": page}


def outdated(program: str) -> list[str]:
    """Return names of the pages of a program whose tables are not what it says now."""
    return [
        file
        for file, page in pages_of(program).items()
        if _tables(page) != _tables((OUT / file).read_text())
    ]


def _tables(page: str) -> list[str]:
    return [line for line in page.splitlines() if line.startswith("|")]  # usage is Python's


if __name__ == "__main__":
    os.environ["COLUMNS"] = "80"  # of usage
    for file, page in pages_of(sys.argv[1]).items():
        (OUT / file).write_text(page)
