"""Pages of the site that are not in docs/: from elsewhere in the repository, generated, or sources.

Pages are written for a reader of the repository: their links are relative to their own place and
may lead out of docs/. On the site such a link leads to the page that the file has become, or else
to a page that shows the file.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

ROOT = Path(__file__).parents[1]
DOCS, GENERATED = ROOT / "docs", ROOT / "build" / "reference"
NOTEBOOK = "docs/tutorials/notebook.ipynb"
PLACES = {
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "LICENSE": "project/licence.md",
    "SECURITY.md": "project/security.md",
    "docker/README.md": "how-to/containers.md",
    "shared_schema/README.md": "background/dataset-format.md",
    NOTEBOOK: "tutorials/notebook.md",
}
LANGUAGES = {".py": "python", ".yaml": "yaml", ".c": "c", ".geo": "c", ".sbatch": "bash"}
LINK = re.compile(r"(\]\()([^)\s:#]+)((?:#[^)\s]*)?\))")
FENCED = re.compile(r"^(```+).*?^\1\s*$", re.MULTILINE | re.DOTALL)
OUTPUTS = "notebook_files"  # folder of the notebook's pictures
SOURCES = "source/"  # folder of the pages that show files


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for page in sorted(GENERATED.glob("*.md")):
        files.append(File.generated(config, f"reference/{page.name}", abs_src_path=str(page)))
    for source, place in PLACES.items():
        if source == NOTEBOOK:
            _add_notebook(files, config)
        else:
            files.append(File.generated(config, place, content=_text(source)))
    for source in sorted(_linked_sources(files)):
        files.append(File.generated(config, _page_of(source), content=_shown(source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Lead links out of docs/ to the pages of the site."""
    place = page.file.src_uri

    def on_site(match: re.Match[str]) -> str:
        target = _target(match[2], place)
        if target is None:
            return match[0]
        page = _page_of(target)
        relative = os.path.relpath(page, Path(place).parent)
        return f"{match[1]}{relative}{')' if page.startswith(SOURCES) else match[3]}"

    return _outside_fences(markdown, lambda text: LINK.sub(on_site, text))


def _outside_fences(markdown: str, change) -> str:  # type: ignore[no-untyped-def]
    parts, end = [], 0
    for block in FENCED.finditer(markdown):
        parts += [change(markdown[end : block.start()]), block[0]]
        end = block.end()
    return "".join([*parts, change(markdown[end:])])


def _add_notebook(files: Files, config: MkDocsConfig) -> None:
    exporter = MarkdownExporter()
    exporter.exclude_input_prompt = exporter.exclude_output_prompt = True
    body, resources = exporter.from_filename(str(ROOT / NOTEBOOK), {"output_files_dir": OUTPUTS})
    place = PLACES[NOTEBOOK]
    files.append(File.generated(config, place, content=body))
    for name, content in resources["outputs"].items():
        files.append(File.generated(config, f"{Path(place).parent}/{name}", content=content))


def _linked_sources(files: Files) -> set[str]:
    """Return the files and folders of the repository to which pages link and which are no pages."""
    sources: set[str] = set()
    for file in files.documentation_pages():
        text = FENCED.sub("", file.content_string)
        targets = (_target(match[2], file.src_uri) for match in LINK.finditer(text))
        sources.update(target for target in targets if target is not None)
    return {source for source in sources if _page_of(source).startswith(SOURCES)}


def _target(link: str, place: str) -> str | None:
    """Return the path in the repository to which a link of a page leads; None if there is none.

    Parameters
    ----------
    link : str
        Relative link.
    place : str
        Path of the page in docs/.
    """
    origin = next((source for source, page in PLACES.items() if page == place), f"docs/{place}")
    path = Path(os.path.normpath(ROOT / Path(origin).parent / link))
    return (
        path.relative_to(ROOT).as_posix() if path.exists() and path.is_relative_to(ROOT) else None
    )


def _page_of(target: str) -> str:
    """Return the path in docs/ of the page that a file or folder of the repository becomes."""
    in_docs = target.startswith("docs/") and (ROOT / target).is_file()
    return PLACES.get(target) or (
        target.removeprefix("docs/") if in_docs else f"{SOURCES}{target}.md"
    )


def _text(source: str) -> str:
    text = (ROOT / source).read_text()
    return f"# Licence\n\n```text\n{text}```\n" if source == "LICENSE" else text


def _shown(source: str) -> str:
    """Return a page that shows a file, or lists a folder."""
    path = ROOT / source
    head = f"---\nsearch: {{exclude: true}}\n---\n\n# `{source}`\n\n"
    if path.is_dir():
        names = sorted(p.name + "/" * p.is_dir() for p in path.iterdir() if p.name[0] not in "._")
        return head + "".join(f"- `{name}`\n" for name in names)
    language = LANGUAGES.get(path.suffix, "bash" if path.name == "Makefile" else "text")
    return f"{head}````{language}\n{path.read_text()}````\n"
