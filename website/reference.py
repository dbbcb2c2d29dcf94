"""Pages of the reference made from the programs: arguments of their commands, keys of their YAML.

Each program's pages are made in its own environment: ``python -m website.reference datagen``.
"""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from website.model_keys import keys_page

OUT = Path(__file__).parents[1] / "build" / "reference"


def commands_page(program: str) -> str:
    """Describe every command of a program: what it does, its usage and its arguments."""
    parser = import_module(f"{program}.command_line")._parser()
    lines = [f"# Commands of `{program}`", "", f"{parser.description} {parser.epilog}"]
    for name, command in commands_of(parser).items():
        lines += ["", f"## {program} {name}", "", f"{command.description or ''}", ""]
        lines += ["```text", command.format_usage().removeprefix("usage: ").rstrip(), "```", ""]
        lines += ["| argument | meaning |", "|---|---|"]
        lines += [
            f"| {_named(action)} | {_meaning(action)} |"
            for action in command._actions
            if not isinstance(action, argparse._HelpAction)
        ]
        if command.epilog:
            lines += ["", "```text", command.epilog.strip(), "```"]
    return "\n".join(lines) + "\n"


def commands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of all commands by name, with what each does as its description."""
    (action,) = (a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    helps = {choice.dest: choice.help for choice in action._choices_actions}
    for name, command in action.choices.items():
        command.description = command.description or _sentence(helps.get(name) or "")
    return dict(action.choices)


def _named(action: argparse.Action) -> str:
    value = action.metavar or ("" if action.nargs == 0 else (action.dest or "").upper())
    if action.choices is not None and not action.metavar:
        value = "|".join(str(choice) for choice in action.choices)
    words = f"{action.option_strings[-1]} {value}" if action.option_strings else str(value)
    return f"`{_cell(words.strip())}`"


def _meaning(action: argparse.Action) -> str:
    text = _sentence(action.help or "")
    unsaid = action.default in (None, False, argparse.SUPPRESS) or action.default == float("inf")
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
    pages = {f"{program}-commands.md": commands_page(program)}
    if program == "datagen":
        pages["case-keys.md"] = keys_page(**_case())
    else:
        pages["configuration-keys.md"] = keys_page(**_configuration())
    return pages


def _case() -> dict[str, Any]:
    from datagen.cases.case import Case
    from datagen.loads.family import SHIPPED

    families = {
        f"`load: {{family: {name}}}`": getattr(
            import_module(place.split(":")[0]), place.split(":")[1]
        )
        for name, place in SHIPPED.items()
    }
    intro = "A case is a YAML file with the keys below; `datagen` refuses any other key."
    return {"title": "Keys of a case", "intro": intro, "models": {"Every case": Case} | families}


def _configuration() -> dict[str, Any]:
    from surrogate.runs.configuration import KINDS

    intro = (
        "A configuration is a YAML file. Its keys `model` and `likelihood` choose the kind of "
        "model; each kind has the keys below, and `surrogate` refuses any other key."
    )
    models = {
        f"`model: {words[1]}, likelihood: {words[3]}`": model
        for words, model in (
            (kind.strip("()").replace(",", "").split(), m) for kind, m in KINDS.items()
        )
    }
    return {"title": "Keys of a configuration", "intro": intro, "models": models}


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    for file, page in pages_of(sys.argv[1]).items():
        (OUT / file).write_text(page)
