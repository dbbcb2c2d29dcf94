"""The command ``schema`` of both programs: prints the keys of their YAML files."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from shared_schema.common.command_line import Parser
from shared_schema.common.errors import InputError
from shared_schema.common.keys.json_schema import Schema
from shared_schema.common.keys.key_list import Key, as_markdown, as_text


def add_arguments(parser: Parser) -> None:
    """Add KEY and --format."""
    parser.add_argument(
        "key", nargs="?", default="", metavar="KEY", help="only this key or section"
    )
    parser.add_argument(
        "--format",
        choices=("text", "markdown", "json"),
        default="text",
        help="text (default), a table in Markdown, or JSON Schema for editors",
    )


def printed(options: argparse.Namespace, keys: Sequence[Key], schema: Schema) -> str:
    """Return what the command prints; InputError if there is no such key."""
    if options.format == "json":
        if options.key:
            raise InputError(f"KEY '{options.key}': expected none with --format json")
        return json.dumps(schema, indent=1, ensure_ascii=False)
    part = options.key
    chosen = [key for key in keys if f"{key.name}.".startswith(f"{part}." if part else "")]
    if not chosen:
        sections = dict.fromkeys(key.name for key in keys if "." not in key.name)
        raise InputError(f"KEY '{part}': no such key, expected one of {', '.join(sections)}")
    return as_markdown(chosen) if options.format == "markdown" else as_text(chosen)
