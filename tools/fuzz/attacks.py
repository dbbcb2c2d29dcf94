"""Attacks on files and commands: damaged files, changed YAML, changed command lines, kills.

Each executes one command and judges how it ends. Exit codes 0, 1 and 2 with one line are right,
also for input that is not; a traceback, a crash, a hang and a result that differs without a word
are findings.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from tools.fuzz.material import COMMANDS, DONE, Material, digests
from tools.fuzz.mutations import change_file, change_text, change_words

PROGRESS = (" samples, ", " epochs, ")  # of a command that works for a long time
CODES = (0, 1, 2, 3)


@dataclass(frozen=True)
class Outcome:
    """How one attack ended.

    Attributes
    ----------
    command : str
        Name of the command.
    change : str
        What was changed or done.
    ending : str
        Such as "exit 2", or "killed".
    finding : str
        What is wrong; empty if nothing is.
    stderr : str
        End of the text on standard error.
    """

    command: str
    change: str
    ending: str
    finding: str = ""
    stderr: str = ""


Attack = Callable[[Random, Material, Path], Outcome]


def damage(random: Random, material: Material, folder: Path) -> Outcome:
    """Change one file of what a command reads; if it succeeds, its result is that of before."""
    folders = {"nodal", "structured", "run"}
    name = random.choice([n for n, c in COMMANDS.items() if folders & set(c.reads)])
    material.lay_out(name, folder)
    parts = [part for part in COMMANDS[name].reads if part in folders]
    files = [p for part in parts for p in sorted((folder / part).rglob("*")) if p.is_file()]
    path = random.choice(files)
    changed = f"{change_file(random, path)} in {path.parent.relative_to(folder)}"
    answer = material.execute(name, list(COMMANDS[name].words), folder)
    finding = judged(answer)
    if not finding and answer["code"] in DONE:
        damaged = str(path.relative_to(folder))
        if name.startswith("check"):
            finding = "damage is called intact"
        else:
            finding = difference(name, material, folder, answer, damaged)
    return outcome(name, changed, answer, finding)


def configure(random: Random, material: Material, folder: Path) -> Outcome:
    """Change the YAML file of a command; wrong input writes nothing."""
    name = random.choice(("run", "solve", "train"))
    material.lay_out(name, folder)
    path = folder / next(part for part in COMMANDS[name].reads if part.endswith(".yaml"))
    path.write_text(change_text(random, path.read_text()), encoding="utf-8")
    answer = material.execute(name, list(COMMANDS[name].words), folder)
    finding = judged(answer)
    left = [file.name for file in folder.iterdir() if file.name not in COMMANDS[name].reads]
    if not finding and answer["code"] == 2 and left:
        finding = f"wrong input left {', '.join(left)}"
    return outcome(name, path.read_text(encoding="utf-8"), answer, finding)


def command_line(random: Random, material: Material, folder: Path) -> Outcome:
    """Change the words of a command."""
    name = random.choice(list(COMMANDS))
    material.lay_out(name, folder)
    words = change_words(random, list(COMMANDS[name].words))
    answer = material.execute(name, words, folder)
    return outcome(name, repr(words), answer, judged(answer))


def kill(random: Random, material: Material, folder: Path) -> Outcome:
    """Kill a command at some time; the same command then gives the result of an undisturbed one."""
    name = random.choice([n for n in COMMANDS if not n.startswith(("check", "info"))])
    material.lay_out(name, folder)
    words, moment = list(COMMANDS[name].words), random.uniform(0, material.seconds[name])
    first = material.execute(name, words, folder, kill_after=moment)
    if first["ended"] == "itself" and (judged(first) or first["code"] not in DONE):
        return outcome(name, "none", first, judged(first) or "fails on undamaged input")
    answer = material.execute(name, words, folder)
    finding = judged(answer)
    if not finding and answer["code"] not in DONE:
        finding = "does not go on after a kill"
    if not finding:
        finding = difference(name, material, folder, answer)
    return outcome(name, f"SIGKILL after {moment:.2f} s", answer, finding)


FILES: dict[str, Attack] = {
    "damaged files": damage,
    "changed YAML": configure,
    "changed command lines": command_line,
    "kills": kill,
}


def judged(answer: dict[str, Any]) -> str:
    """Say what is wrong with how a command ended; empty if nothing is."""
    text = answer["stderr"] + answer["stdout"]
    if "Traceback (most recent call last)" in text:
        return "traceback"
    if answer["ended"] == "hang":
        return "" if any(word in text for word in PROGRESS) else "hang"
    if answer["code"] not in CODES:
        return f"crash ({answer['code']})"
    if answer["code"] and not text.strip():
        return "fails without a word"
    return ""


def difference(
    name: str, material: Material, folder: Path, answer: dict[str, Any], damaged: str = ""
) -> str:
    """Say in what a result differs from that on undamaged input; empty if in nothing."""
    found = digests(folder) | {"stdout": answer["stdout"]}
    for key, value in material.results[name].items():
        if damaged and key.startswith(damaged):
            continue
        if key == "stdout" and name in ("rerun", "grow", "retrain", "evaluate"):
            continue  # which may say that nothing was left to do
        if name in ("rerun", "grow") and key.endswith((".sha256", "digest")):
            continue  # of a damaged shard that is solved again, in another time
        if found.get(key) != value:
            return f"silently changed result: {key}"
    return ""


def outcome(name: str, change: str, answer: dict[str, Any], finding: str) -> Outcome:
    ending = f"exit {answer['code']}" if answer["ended"] == "itself" else answer["ended"]
    return Outcome(name, change, ending, finding, answer["stderr"][-2000:])
