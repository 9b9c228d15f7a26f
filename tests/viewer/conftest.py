"""A browser for pages of the viewer."""

from contextlib import contextmanager

import pytest
from looking import FLAGS, SOFTWARE, chromium_path


@pytest.fixture(scope="session")
def chromium():
    """Launches Chromium with further flags; skips where it or playwright is missing."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is missing: pip install '.[browser]'")
    program = chromium_path()
    if program is None:
        pytest.skip("Chromium is missing: apt-get install chromium, or name it in PLENOPTIC_CHROMIUM")
    with api.sync_playwright() as playwright:
        yield lambda *flags: playwright.chromium.launch(executable_path=program, args=[*FLAGS, *flags])


@pytest.fixture(scope="session")
def browser(chromium):
    launched = chromium(*SOFTWARE)
    yield launched
    launched.close()


@pytest.fixture
def opened(browser, tmp_path):
    """A context manager: a page from the disk, in which nothing may be said on the console and nothing be loaded."""

    @contextmanager
    def open_page(viewer, width=1280, height=800, **context):
        path = tmp_path / "page.html"
        viewer.save(path)
        surroundings = browser.new_context(viewport={"width": width, "height": height}, **context)
        page, said, asked = surroundings.new_page(), [], []
        page.on("console", lambda message: said.append((message.type, message.text)))
        page.on("pageerror", lambda error: said.append(("error", str(error))))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_selector("#stage[data-ready]", state="attached", timeout=60_000)
        yield page
        assert said == []
        assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [path.as_uri()]
        surroundings.close()

    return open_page
