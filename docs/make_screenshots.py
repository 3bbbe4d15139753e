# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The screenshots of docs/page.md: a simulated shift with faults, recorded, on the page.

Needs Chromium and its driver: python3 docs/make_screenshots.py, after source setup/environment.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
import sys
from tempfile import TemporaryDirectory

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / 'test/support'))

from browsers import open_browser, text_of, until  # noqa: E402
from lines import edges_of, saturated_at, simulated, without_edges  # noqa: E402
from selenium.webdriver import Chrome  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from served_page import served  # noqa: E402

from checkweigher_core.recording import Recording  # noqa: E402
from checkweigher_core.records import EyeEdge  # noqa: E402
from checkweigher_recording.bags.writing import write_bag  # noqa: E402

MS = 1_000_000  # ns
COUNT, MISSING, EARLY, SATURATED = 60, 24, 36, 48  # items; of the faults their places
# Name, size in px, how often "previous fault" is pressed, and the parts that are shown.
SHOTS: Sequence[tuple[str, tuple[int, int], int, str]] = (
    ('page', (1280, 1400), 0, 'body'),
    ('page_missing_edge', (1280, 900), 3, '.panel[aria-label=Signal]'),
    ('page_edge_mismatch', (1280, 900), 2, '.panel[aria-label=Signal]'),
    ('page_phone', (390, 780), 3, 'body'),
)


def shift() -> Recording:
    """Return a shift in which an eye missed an edge, edges were early and the cell saturated."""
    sound = simulated(count=COUNT, seed=3, masses=(0.1345,))
    broken = saturated_at(sound, edges_of(sound, SATURATED)['t2'].stamp + 50 * MS)
    early: list[EyeEdge] = list(edges_of(sound, EARLY).values())
    broken = without_edges(broken, edges_of(sound, MISSING)['t3'], *early)
    moved = [replace(edge, stamp=edge.stamp - 9 * MS) for edge in early]
    edges = sorted((*broken.edges, *moved), key=lambda edge: edge.stamp)
    return replace(broken, edges=tuple(edges))


def shoot(page: Chrome, name: str, size: tuple[int, int], faults: int, part: str) -> None:
    """Write one screenshot."""
    page.set_window_size(*size)
    page.refresh()
    until(page, lambda: text_of(page, '.where').startswith(f'item {COUNT} of {COUNT}'))
    for _ in range(faults):
        before = text_of(page, '.where')
        button = page.find_element(By.XPATH, '//button[normalize-space()="previous fault"]')
        button.send_keys(Keys.ENTER)
        until(page, lambda before=before: text_of(page, '.where') != before)
    number = text_of(page, '.where').partition(' of')[0]
    until(page, lambda: text_of(page, '.signal .about').startswith(f'{number} at'))
    until(page, lambda: bool(text_of(page, '.marks')) == bool(faults))
    drawn = 'return document.querySelectorAll(".chart canvas").length'
    until(page, lambda: page.execute_script(drawn) == 6)
    page.execute_script('document.activeElement.blur()')
    data = page.find_element(By.CSS_SELECTOR, part).screenshot_as_png if part != 'body' else \
        page.get_screenshot_as_png()  # fmt: skip
    path = HERE / f'{name}.png'
    path.write_bytes(data)
    print(f'{path}: {len(data) / 1000:.0f} kB')


def main() -> None:
    """Make all screenshots."""
    with TemporaryDirectory(prefix='checkweigher-') as folder:
        bag, recording = Path(folder) / 'shift', shift()
        write_bag(bag, recording.load_cell, recording)
        with served('--bag', str(bag)) as (_, port), open_browser(Path(folder) / 'c') as page:
            page.get(f'http://127.0.0.1:{port}/')
            until(page, lambda: f'{COUNT} items' in text_of(page, '.recording'))
            for shot in SHOTS:
                shoot(page, *shot)


if __name__ == '__main__':
    main()
