"""Random changes of bytes, of YAML and JSON texts, and of command lines."""

from __future__ import annotations

import json
import re
from pathlib import Path
from random import Random

NASTY = (  # values in texts and on command lines
    *("-1", "0", "1", "3", "1e308", "-1e308", "1e-308", "nan", "inf", "1e30", "9" * 30, "9" * 5000),
    *("true", "null", "''", "'6'", "[]", "{}", "[1, 2]", "1.5", "0x10", "1_0", "2026-01-01", "~"),
    *("*a", "&a [*a]", "!!python/name:os.system", "é", "\u202e", "a: b", "- 1", "{<<: {a: 1}}"),
)
WORDS = (
    *(
        "",
        "-1",
        "0",
        "2",
        "1e308",
        "nan",
        "inf",
        "9" * 30,
        "0:0",
        "1:0",
        "0:99",
        "1,1,1",
        "4,1:0,-1",
    ),
    *("4,1:nan,0", "4,1:1e308,0", "0,1:1,1", "2,2", "100000,100000", "1,2,3,4", "--help", "--"),
    *("--samples", "--out", "--grid", "--seed", "--load", "--volumetric", "quadratic", "random"),
    *("nothing", ".", "..", "nodal", "structured", "run", "case.yaml", "config.yaml", "/dev/null"),
    *("a" * 300, "ä\u202e", "a b", "a\nb", "out.npz", "out.png", "out.xdmf", "out.html", "run/x"),
)
NUMBER = re.compile(r"-?\d+(\.\d+)?([eE][-+]?\d+)?")


def change_file(random: Random, path: Path) -> str:
    """Change a file's bytes, or remove it; return what was done."""
    content = path.read_bytes()
    kinds = ["flip", "flip", "flip", "truncate", "zeros", "append", "empty", "remove"]
    if path.suffix in (".json", ".jsonl", ".yaml"):
        kinds += ["text", "text", "json", "json"]
    kind = random.choice(kinds) if content else "append"
    place = random.randrange(max(1, len(content)))
    if kind == "remove":
        path.unlink()
        return f"remove {path.name}"
    if kind == "flip":
        changed = bytearray(content)
        changed[place] ^= 1 << random.randrange(8)
    elif kind == "truncate":
        changed = bytearray(content[:place])
    elif kind == "zeros":
        size = random.randrange(1, 4096)
        changed = bytearray(content[:place] + bytes(size) + content[place + size :])
    elif kind == "append":
        changed = bytearray(content + random.randbytes(random.randrange(1, 64)))
    elif kind == "text":
        changed = bytearray(change_text(random, content.decode(errors="replace")).encode())
    elif kind == "json":
        changed = bytearray(random.choice(("[]", "{}", "3", "null", '"a"', "[{}]")).encode())
    else:
        changed = bytearray()
    if bytes(changed) == content:
        changed += b"\n"
    path.write_bytes(changed)
    return f"{kind} {path.name} at {place} of {len(content)}"


def change_text(random: Random, text: str) -> str:
    """Change a YAML or JSON text in one to three places."""
    for _ in range(random.choice((1, 1, 2, 3))):
        lines = text.splitlines() or [""]
        place = random.randrange(len(lines))
        kind = random.choice(("number", "number", "value", "value", "drop", "twice", "byte", "key"))
        if kind == "number":
            found = list(NUMBER.finditer(text))
            if found:
                hit = random.choice(found)
                text = text[: hit.start()] + random.choice(NASTY) + text[hit.end() :]
            continue
        if kind == "value":
            lines[place] = re.sub(r":.*", lambda _: f": {random.choice(NASTY)}", lines[place])
        elif kind == "drop":
            del lines[place]
        elif kind == "twice":
            lines.insert(place, lines[random.randrange(len(lines))])
        elif kind == "key":
            lines[place] = re.sub(
                r"\w+:", f"{random.choice(('a', 'name', '<<', '1'))}:", lines[place]
            )
        elif lines[place]:
            at = random.randrange(len(lines[place]))
            lines[place] = (
                lines[place][:at] + chr(random.randrange(1, 256)) + lines[place][at + 1 :]
            )
        text = "\n".join(lines) + "\n"
    return text


def change_words(random: Random, words: list[str]) -> list[str]:
    """Change a command line in one to three places; the command itself mostly stays."""
    words = list(words)
    for _ in range(random.choice((1, 1, 2, 3))):
        place = random.randrange(0 if random.random() < 0.05 else 1, max(2, len(words)))
        kind = random.choice(("replace", "replace", "insert", "drop", "swap", "twice"))
        if place >= len(words) or kind == "insert":
            words.insert(place, random.choice(WORDS))
        elif kind == "replace":
            words[place] = random.choice(WORDS)
        elif kind == "drop":
            del words[place]
        elif kind == "twice":
            words.insert(place, words[place])
        else:
            other = random.randrange(len(words))
            words[place], words[other] = words[other], words[place]
    return words


def leaves(content: object, prefix: str) -> dict[str, str]:
    """Every number and text of a JSON value, by its path."""
    if isinstance(content, dict):
        parts = [leaves(value, f"{prefix}.{key}") for key, value in content.items()]
    elif isinstance(content, list):
        parts = [leaves(value, f"{prefix}.{place}") for place, value in enumerate(content)]
    else:
        return {prefix: json.dumps(content)}
    return {name: value for part in parts for name, value in part.items()}
