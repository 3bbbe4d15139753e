# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Check the local links of a site: python3 docs/site/links.py FOLDER."""

from html.parser import HTMLParser
from pathlib import Path
import sys
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding='utf-8'))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Add the link and the anchor of a tag."""
        for name, value in attributes:
            if name in ('href', 'src') and value:
                self.links.append(value)
            elif name in ('id', 'name') and value:
                self.anchors.add(value)


def broken_links(folder: Path) -> list[str]:
    """Return the local links of all pages below a folder that lead nowhere, with their pages."""
    paths = (path for path in folder.rglob('*.html') if '_static' not in path.parts)
    pages = {path.resolve(): Page(path) for path in paths}
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            anchor = unquote(parts.fragment)
            known = target.exists() and (not anchor or target not in pages)
            if not known and not (target in pages and anchor in pages[target].anchors):
                broken.append(f'{path.relative_to(folder.resolve())}: {link}')
    return broken


if __name__ == '__main__':
    found = broken_links(Path(sys.argv[1]))
    print('\n'.join([*found, f'{len(found)} broken links']))
    sys.exit(bool(found))
