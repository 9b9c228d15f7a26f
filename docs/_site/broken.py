"""A warning for each link within the built pages that leads nowhere, and for what is loaded from other hosts."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlparse

from sphinx.application import Sphinx
from sphinx.util import logging

LOADED = {"script", "link", "img", "iframe", "source", "video"}


class Page(HTMLParser):
    """Where a page leads, what it loads, and the places in it that can be led to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: set[tuple[str, str]] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, given in attrs:
            if name == "id" and given:
                self.places.add(given)
            elif name in ("href", "src") and given:
                self.links.add((tag, given))


def faults(folder: Path) -> list[str]:
    paths = [path for path in folder.resolve().rglob("*.html") if "_static" not in path.parts]
    pages = {path: Page(path) for path in paths}
    found = []
    for path, page in pages.items():
        for tag, link in page.links:
            url = urlparse(link)
            where = path if not url.path else (path.parent / unquote(url.path)).resolve()
            if url.scheme or url.netloc:
                broken = tag in LOADED and url.scheme != "data"
            else:
                broken = not where.exists() or bool(
                    url.fragment and where in pages and unquote(url.fragment) not in pages[where].places
                )
            if broken:
                found.append(f"{path.relative_to(folder.resolve())}: {link}")
    return sorted(found)


def check(app: Sphinx, error: Exception | None) -> None:
    if error is None and app.builder.name == "html":
        for fault in faults(Path(app.outdir)):
            logging.getLogger(__name__).warning("leads nowhere, or to another host: %s", fault)


def setup(app: Sphinx) -> None:
    app.connect("build-finished", check, priority=900)
