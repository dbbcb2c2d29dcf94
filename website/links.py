"""Check of all links of the built site: every file and every anchor that a page names exists.

MkDocs checks the links of Markdown; this looks at what became of them, and of all others.
"""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError


class Page(HTMLParser):
    """Links and anchors of a page.

    Attributes
    ----------
    links, anchors : set of str
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Collect the links and the anchor of a tag."""
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.links.add(value)
            elif name in ("id", "name") and value:
                self.anchors.add(value)


def dead_links(site: Path) -> list[str]:
    """Return "page: link" of every link within a site that leads nowhere."""
    pages = {path: Page(path) for path in site.rglob("*.html")}
    return [
        f"{path.relative_to(site)}: {link}"
        for path, page in pages.items()
        for link in sorted(page.links)
        if not _leads_somewhere(link, path, pages)
    ]


def on_post_build(config: MkDocsConfig) -> None:
    """Fail if a link is dead."""
    dead = [line for line in dead_links(Path(config.site_dir)) if not line.startswith("404.html:")]
    if dead:
        raise PluginError("\n".join(["dead links:", *dead]))


def _leads_somewhere(link: str, path: Path, pages: dict[Path, Page]) -> bool:
    parts = urlsplit(link)
    if parts.scheme or parts.netloc:
        return True
    target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    target = target / "index.html" if target.is_dir() else target
    anchor = unquote(parts.fragment)
    anchored = not anchor or target not in pages or anchor in pages[target].anchors
    return target.is_file() and anchored
