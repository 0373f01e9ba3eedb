"""`make docs` makes a site of the pages without a warning, and the site loads nothing from anywhere."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import unquote

import pytest
from pages_for_tests import PAGES, ROOT

import ge_torchrl

pytest.importorskip("furo", reason="the extra docs is not installed")
LOADS = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src", "object": "data"}


class Page(HTMLParser):
    """What a page loads, where its links lead, and the ids that links may name."""

    def __init__(self, text):
        super().__init__()
        self.loaded, self.links, self.ids = [], [], set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.ids.add(attributes.get("id"))
        if (target := attributes.get(LOADS.get(tag))) is not None:
            self.loaded.append(target)
        if tag == "a" and "href" in attributes:
            self.links.append(attributes["href"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    (command,) = re.findall(r"sphinx-build (.*)", (ROOT / "Makefile").read_text())
    words = command.replace("build/doctrees", str(folder / "doctrees")).removesuffix("docs site").split()
    built = subprocess.run(
        [sys.executable, "-m", "sphinx", *words, "docs", str(folder / "site")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (built.returncode, built.stderr) == (0, "")
    return {path.name: Page(path.read_text()) for path in (folder / "site").glob("*.html")}, folder / "site"


def test_every_page_is_in_it(site):
    pages, folder = site
    assert {f"{path.stem}.html" for path in PAGES if path.name != "README.md"} <= pages.keys()
    assert (folder / "index.html").is_file()
    menu = set(pages["index.html"].links)
    assert {f"{path.stem}.html" for path in PAGES if path.stem not in ("README", "index")} <= menu


def test_it_loads_nothing_from_anywhere(site):
    pages, folder = site
    for name, page in pages.items():
        assert [target for target in page.loaded if "//" in target] == [], name
    for path in folder.rglob("*.css"):
        assert not re.search(r"(?:@import|url\()\s*[\"']?(?:https?:)?//", path.read_text()), path.name


def test_its_links_lead_somewhere(site):
    pages, folder = site
    for name, page in pages.items():
        for link in page.links:
            path, _, anchor = unquote(link).partition("#")
            if "://" in link or path.startswith("mailto:"):
                continue
            assert not path or (folder / path).is_file(), f"{name}: {link}"
            if anchor and (target := pages.get(path or name)) is not None:
                assert anchor in target.ids, f"{name}: {link}"


def test_the_reference_has_all_that_the_library_offers(site):
    pages, _ = site
    offered = {f"ge_torchrl.{name}" for name in ge_torchrl.__all__ if name != "__version__"}
    assert offered <= pages["api.html"].ids
