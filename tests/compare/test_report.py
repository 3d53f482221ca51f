"""The report: whole, self-contained, safe to open, and its table sorts in a browser."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from PIL import Image

from kinreach.compare.report import report_html, write_report
from kinreach.compare.report_pictures import Rendering, chosen, render_trials
from kinreach.compare.summary import summarise
from kinreach.compare.trials import Trial
from kinreach.errors import InstallationError

HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=alert(1)> & ${title} \N{BULLET}"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture
def trials(make_trials, impossible) -> list[Trial]:
    """Of three methods, the last of which has a name, a status and a reason that somebody wants to run."""
    bad = replace(impossible, goal=4, method=HOSTILE, status=HOSTILE, reason=HOSTILE)
    return [
        *make_trials(5, method="lm", distance=0.004),
        *make_trials(5, method="closed-form"),
        *make_trials(4, method=HOSTILE, distance=0.02, reached=False),
        bad,
    ]


@pytest.fixture
def results(trials) -> dict[str, Any]:
    names = list(dict.fromkeys(trial.method for trial in trials))
    settings = {
        "task": "ur5", "methods": names, "goals": 5, "seed": 3, "observation": "geometric", "camera": None,
        "command": f"python -m kinreach.compare --methods '{HOSTILE}'", "confidence": 0.95, "intervals": "Wilson",
        "terms": {"reached": "d < 10 mm and r_e < 0.15"}, "machine": {"processor": "one", "cores": 2, "system": None},
    }  # fmt: skip
    return {
        "methods": [summarise(name, "solver", [t for t in trials if t.method == name]) for name in names],
        "settings": settings,
        "versions": {"python": "3.11", "placo": None, HOSTILE: HOSTILE},
    }


@pytest.fixture
def page(results, tmp_path) -> str:
    charts = {HOSTILE: tmp_path / "errors.png", "times": tmp_path / "times.png"}
    picture = BytesIO()
    for path in charts.values():
        Image.new("RGB", (160, 80), "red").save(path)
    Image.new("RGB", (16, 9)).save(picture, "JPEG")
    return report_html(results, charts, [Rendering(HOSTILE, f"caption {HOSTILE}", picture.getvalue())])


class Reader(HTMLParser):
    """Elements with their attributes, texts by the element they are in, and what was left open."""

    VOID: ClassVar[set[str]] = {"meta", "link", "img", "br"}

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append((self.open[-1] if self.open else "", data.strip()))

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    def text(self, tag: str) -> list[str]:
        return [text for name, text in self.texts if name == tag and text]


def test_everything_is_in_it(page, results):
    reader = Reader(page)
    assert reader.open == []
    assert reader.text("h2") == ["Methods", "Figures", "Renderings", "Settings", "Versions"]
    assert results["settings"]["command"] in reader.text("code")
    cells = reader.text("td") + reader.text("th")
    for said in ("lm", "closed-form", "100.0 [56.6, 100.0]", "0.95", "3.11", "not installed", "Wilson", "processor"):
        assert any(said in cell for cell in cells), said
    images = [(image["src"].partition(";")[0], image["alt"], image.get("width")) for image in reader.all("img")]
    assert images == [
        ("data:image/png", HOSTILE, "96"), ("data:image/png", "times", "96"), ("data:image/jpeg", "", None),
    ]  # fmt: skip


def test_nothing_is_fetched(page):
    reader = Reader(page)
    for _, attributes in reader.elements:
        for name in ("src", "href", "action", "srcset", "data", "poster"):
            assert (attributes.get(name) or "data:").startswith("data:")
    without_pictures = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert not re.search(r"https?:|//[a-z]|url\(|@import", without_pictures)
    (policy,) = [meta["content"] for meta in reader.all("meta") if meta.get("http-equiv")]
    assert policy.startswith("default-src 'none';")


def test_texts_stay_texts(page):
    """Wherever a name, a path, a status or a version ends up, it is read back as it was and makes no element."""
    reader = Reader(page)
    assert len(reader.all("script")) == 1
    assert not [image for image in reader.all("img") if image["src"] == "x"]
    assert not [name for _, attributes in reader.elements for name in attributes if name.startswith("on")]
    assert sum(HOSTILE in text for _, text in reader.texts) >= 6
    assert HOSTILE in [cell.get("data-value") for cell in reader.all("th")]


def test_columns_that_say_nothing_are_left_out(results, trials):
    said = Reader(report_html(results, {}, "None.")).text("button")
    assert not [heading for heading in said if heading.startswith("seen")]
    for method in results["methods"]:
        method["observed_error_mm"] = {"median": 0.1, "p95": 0.2}
        del method["kind"]
    said = Reader(report_html(results, {}, "None.")).text("button")
    assert len([heading for heading in said if heading.startswith("seen")]) == 2
    assert "kind" not in said


def test_without_opengl_a_sentence_says_so(results, trials, tmp_path, monkeypatch):
    def no_library(*_: object) -> None:
        raise InstallationError("cannot draw:\n  install libegl1")

    monkeypatch.setattr("kinreach.compare.report.render_trials", no_library)
    write_report(tmp_path / "report.html", trials, results, {})
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    reader = Reader((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "None: cannot draw: install libegl1" in reader.text("p")
    assert reader.all("img") == []


def test_an_ordinary_success_and_the_worst_end_are_chosen(make_trials, impossible):
    good = [replace(trial, distance=1e-3 * d) for trial, d in zip(make_trials(5), (5, 1, 4, 2, 3), strict=True)]
    assert {what: trial.goal for what, trial in chosen(good).items()} == {
        "success": 4,
        "largest distance, reached all the same": 0,
    }
    far = replace(good[0], goal=7, reached=False, distance=0.9)
    assert chosen([*good, far])["worst failure"] == far
    assert chosen([*good, far, impossible])["worst failure"] == impossible
    assert list(chosen([far])) == ["worst failure"]


def test_trials_are_drawn_as_they_ended(trials, results, monkeypatch):
    """Arm and ball stand where the trial had them; a trial without a posture leaves the arm at the start."""
    drawn = []

    class Camera:
        def __init__(self, model: Any, **_: Any) -> None:
            self.ball = model.body("ball").mocapid[0]

        def __enter__(self) -> Camera:
            return self

        def __exit__(self, *_: object) -> None: ...

        def rgb(self, data: Any, camera: str) -> Any:
            drawn.append((data.qpos[:6].copy(), data.mocap_pos[self.ball].copy()))
            return np.zeros((9, 16, 3), dtype=np.uint8)

    monkeypatch.setattr("kinreach.compare.report_pictures.FrameRenderer", Camera)
    outside = replace(trials[0], goal=9, q=(9.0, 0, 0, 0, 0, 0), impossible=True, reached=False)
    found = render_trials([*trials, outside], results)
    assert [rendering.method for rendering in found] == ["lm", "lm", "closed-form", "closed-form", HOSTILE]
    assert [rendering.caption.split(" · ")[0] for rendering in found] == [
        "Success", "Worst failure", "Success", "Largest distance, reached all the same", "Worst failure",
    ]  # fmt: skip
    assert all(rendering.jpeg.startswith(b"\xff\xd8") for rendering in found)
    home = np.array([-np.pi / 2, -np.pi / 2, np.pi / 2, -np.pi / 2, -np.pi / 2, 0])
    for index, (q, ball) in enumerate(drawn):
        np.testing.assert_allclose(q, home if index in (1, 4) else trials[0].q, atol=1e-12)
        np.testing.assert_allclose(ball, (0.4, -0.1, -0.175), atol=1e-12)
    assert [rendering.caption.rpartition(" · ")[2] for rendering in found[:2]] == [
        "the arm where it came to rest", "the arm at the start",
    ]  # fmt: skip


#: A page that holds the report in a frame, clicks, and writes down what it sees there.
PROBE = """<!doctype html><link rel="icon" href="data:,"><iframe src="report.html"></iframe><pre id="seen"></pre>
<script>
addEventListener("load", () => {
  const inside = document.querySelector("iframe").contentDocument;
  const heads = [...inside.querySelectorAll("#methods thead th")];
  const names = () => [...inside.querySelectorAll("#methods tbody tr")].map((row) => row.cells[0].textContent.length);
  const seen = [names()];
  for (const column of [0, 0, heads.findIndex((head) => head.textContent.startsWith("distance"))]) {
    heads[column].querySelector("button").click();
    seen.push([...names(), heads[column].getAttribute("aria-sort")]);
  }
  const move = heads.findIndex((head) => head.textContent.startsWith("move"));
  for (const _ of [0, 1]) { heads[move].querySelector("button").click(); seen.push(names()); }
  seen.push(inside.querySelectorAll("[aria-sort]").length, inside.images.length);
  document.getElementById("seen").textContent = JSON.stringify(seen);
  console.warn("the probe is done");
});
</script>"""


@contextmanager
def served(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """A server of the loopback interface for a folder: its address, and the paths that were asked for."""
    asked: list[str] = []

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            asked.append(self.path)

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}", asked
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@pytest.fixture
def browser() -> str:
    """One that starts; Ubuntu's `chromium-browser` may be a script that only says what to install.

    Skip where there is none; fail instead where `KINREACH_REQUIRE_BROWSER` is set, as in CI.
    """
    for path in filter(None, map(shutil.which, BROWSERS)):
        if subprocess.run([path, "--version"], capture_output=True, timeout=60, check=False).returncode == 0:
            return path
    missing = f"none of {', '.join(BROWSERS)} is installed"
    if os.environ.get("KINREACH_REQUIRE_BROWSER"):
        pytest.fail(f"KINREACH_REQUIRE_BROWSER is set, and {missing}")
    pytest.skip(missing)


@pytest.mark.slow
def test_in_a_browser(page, browser, tmp_path):
    """It opens without a message on the console or a request, and clicks on headings sort the table."""
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "probe.html").write_text(PROBE, encoding="utf-8")
    with served(folder) as (address, asked):
        command = [
            browser, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
            "--enable-logging=stderr", "--virtual-time-budget=10000", "--dump-dom", f"{address}/probe.html",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    messages = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    assert len(messages) == 1, messages
    assert "the probe is done" in messages[0]
    assert sorted(asked) == ["/probe.html", "/report.html"]
    lm, closed, hostile = map(len, ("lm", "closed-form", HOSTILE))
    (said,) = re.findall(r'<pre id="seen">(.*?)</pre>', done.stdout)
    assert said == (
        f"[[{lm},{closed},{hostile}],"  # as measured
        f'[{hostile},{closed},{lm},"ascending"],[{lm},{closed},{hostile},"descending"],'  # by name
        f'[{closed},{lm},{hostile},"ascending"],'  # by distance
        f"[{closed},{lm},{hostile}],[{closed},{lm},{hostile}],1,3]"  # by time: all equal, the order stays
    )
