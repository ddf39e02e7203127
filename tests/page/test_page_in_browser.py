"""The page of results in a real browser: what it draws, how film and curves move together."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from page_documents import write_documents, write_film

from grosmc_mj.errors import SetupError
from grosmc_mj.films.offscreen import find_ffmpeg
from grosmc_mj.page.reading import read_results
from grosmc_mj.page.write import write_page

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
WIDE, NARROW = {"width": 1280, "height": 900}, {"width": 400, "height": 740}

pytestmark = [
    pytest.mark.render,
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium: apt-get install chromium"),
]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_documents(tmp_path_factory.mktemp("results"))
    try:
        film = folder / "made.mp4"
        command = [
            find_ffmpeg().path, "-v", "error", "-f", "lavfi", "-i", "testsrc=s=64x48:r=20:d=3",
            "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(film),
        ]  # fmt: skip
        subprocess.run(command, check=True)
    except SetupError as error:
        pytest.skip(str(error))
    write_film(folder, film.read_bytes())
    path = folder / "report.html"
    write_page(read_results([folder]), [folder], path)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


class Seen:
    """A page in a browser without a net, with its complaints and its requests."""

    def __init__(self, browser: Any, file: Path, **context: Any) -> None:
        self.context = browser.new_context(**{"viewport": WIDE, "offline": True, **context})
        self.page, self.complaints, self.requests = self.context.new_page(), [], []
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(file.as_uri())
        self.page.wait_for_selector("html[data-ready]", state="attached")

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait up to 10 s; the page's policy forbids to evaluate a text inside it."""
        for _ in range(100):
            if holds():
                return
            self.page.wait_for_timeout(100)
        raise AssertionError("still not so after 10 s")

    def cursor(self) -> float:
        """The time of the curves' cursor [s]."""
        return self.page.evaluate(
            "() => document.querySelector('.case .plot').layout.shapes.at(-1).x0"
        )


@pytest.fixture
def seen(browser: Any, page_file: Path) -> Iterator[Seen]:
    shown = Seen(browser, page_file)
    yield shown
    assert shown.complaints == []
    assert [url for url in shown.requests if not url.startswith(("file:", "data:"))] == []
    shown.context.close()


def test_all_charts_are_drawn_without_waiting(seen: Seen) -> None:
    charts = seen.page.evaluate(
        "() => [...document.querySelectorAll('.plot')].map("
        "(home) => home.querySelectorAll('.main-svg').length > 0)"
    )
    assert charts == [True] * 4


def test_film_and_curves_have_one_time(seen: Seen) -> None:
    video = seen.page.locator("video")
    seen.until(lambda: video.evaluate("video => video.readyState > 1"))
    video.evaluate("video => { video.currentTime = 2; }")
    seen.until(lambda: seen.cursor() == pytest.approx(1.25))
    seen.page.locator(".case .plot").evaluate(
        "home => home.emit('plotly_click', { points: [{ x: 1.5 }] })"
    )
    seen.until(lambda: seen.cursor() == pytest.approx(1.5))
    assert video.evaluate("video => video.currentTime") == pytest.approx(2.5)


def test_claims_are_filtered_by_their_verdict(seen: Seen) -> None:
    seen.page.select_option("#verdict", "refuted")
    assert seen.page.locator(".claim").is_visible()
    seen.page.select_option("#verdict", "")
    assert not seen.page.locator(".claim").is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nobody_is_kept_out(browser: Any, page_file: Path, scheme: str) -> None:
    from axe_playwright_python.sync_playwright import Axe

    shown = Seen(browser, page_file, color_scheme=scheme)
    ground = shown.page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(255, 255, 255)") is (scheme == "light")
    violations = Axe().run(shown.page).response["violations"]
    assert [v["id"] for v in violations if v["impact"] in ("serious", "critical")] == []
    shown.context.close()


def test_a_narrow_screen_scrolls_in_one_direction(browser: Any, page_file: Path) -> None:
    shown = Seen(browser, page_file, viewport=NARROW)
    shown.page.evaluate(
        "() => document.querySelectorAll('details').forEach((fold) => { fold.open = true; })"
    )
    wide = shown.page.evaluate("() => document.documentElement.scrollWidth")
    assert wide <= NARROW["width"]


def test_on_paper_there_is_nothing_to_open(seen: Seen) -> None:
    seen.page.evaluate("() => dispatchEvent(new Event('beforeprint'))")
    assert seen.page.locator("main details:not([open])").count() == 0
