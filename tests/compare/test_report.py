"""The report: whole, self-contained, safe to open, and its tables sort in a browser."""

import json
import os
import re
import subprocess
import threading
from contextlib import contextmanager
from dataclasses import replace
from datetime import date
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from kinreach.compare import compare
from kinreach.compare._report import (
    Rendering,
    _caption,
    ordinary_success,
    render_trials,
    report_html,
    worst_failure,
    write_report,
)
from kinreach.compare._runner import prepare, results_of, run_trials
from kinreach.compare._task import _OWN
from kinreach.errors import DrawingError, InstallationError
from kinreach.kinematics import ArmKinematics
from tests.cases import slow

HOSTILE = "<script>alert('x')</script>\"><img src=x onerror=alert(1)> & ${title} \N{BULLET}"


def made_up(method, count, **values):
    good = {
        "goal": [0.1, 0.0, 0.0], "q": [0.1], "distance": 0.0015, "reached": True, "is_success": True,
        "impossible": False, "status": "completed", "impossible_reason": "", "move_s": 1.25, "steps": 1,
        "reward": -0.0015, "return": -0.0015, "solve_s": 2e-4, "method": method,
    }  # fmt: skip
    return [{**good, "goal_index": index, **values} for index in range(count)]


@pytest.fixture
def trials():
    """Of three methods, the last of which has a name, a status and a reason that somebody wants to run."""
    bad = {"impossible": True, "reached": False, "status": HOSTILE, "impossible_reason": HOSTILE, "goal_index": 4}
    return [
        *made_up("lm", 5, distance=0.004),
        *made_up("closed-form", 5),
        *made_up(HOSTILE, 4, distance=0.02, reached=False),
        *made_up(HOSTILE, 1, **bad),
    ]


@pytest.fixture
def task(toy):
    return replace(toy, title=HOSTILE, reached=HOSTILE, notes=lambda results: [f"a note {HOSTILE}"])


@pytest.fixture
def results(trials, task):
    methods = dict.fromkeys(("lm", "closed-form", HOSTILE), task.methods["right"])
    comparison = prepare(
        task, methods, goals=5, seed=3, arm=None, observation=None, options=None, command=f"run '{HOSTILE}'"
    )  # fmt: skip
    return results_of(comparison, trials)


@pytest.fixture
def page(results, task, trials, tmp_path):
    charts = {HOSTILE: tmp_path / "errors.png", "times": tmp_path / "times.png"}
    for path in charts.values():
        Image.new("RGB", (160, 80), "red").save(path)
    black = np.zeros((9, 16, 3), dtype=np.uint8)
    pictures = [Rendering("lm", "a success", black, True), Rendering(HOSTILE, f"caption {HOSTILE}", black)]
    return report_html(task, trials, results, charts, pictures)


class Reader(HTMLParser):
    """Elements with their attributes, texts by the element they are in, and what was left open."""

    VOID = frozenset({"meta", "link", "img", "br"})

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
    assert reader.text("h2") == ["Methods", "Figures", "Failures", "How it was measured"]
    assert results["settings"]["command"] in " ".join(reader.text("span"))
    cells = [text for tag in ("td", "th", "dd", "dt", "small", "strong", "p") for text in reader.text(tag)]
    for said in ("lm", "closed-form", "100.0", "[56.6, 100.0]", "95 %: Wilson", "processor", date.today().isoformat()):
        assert any(said in cell for cell in cells), said
    images = [(image["src"].partition(";")[0], image["alt"], image.get("width")) for image in reader.all("img")]
    assert images == [  # the scene and one figure open the report
        ("data:image/jpeg", "", None), ("data:image/png", HOSTILE, "96"), ("data:image/png", "times", "96"),
        ("data:image/jpeg", "", None),
    ]  # fmt: skip
    assert [link["download"] for link in reader.all("a")] == ["errors.png", "times.png"]


def test_every_number_has_its_count(page):
    """In the head of a column, or in each cell where the methods have other numbers of trials."""
    reader = Reader(page)
    heads = [cell for cell in reader.all("th") if cell.get("data-kind") == "number"]
    counts = [text for text in reader.text("small") if "n = " in text]
    assert counts.count("n = 5") == len(heads) - 1 >= 5
    assert [text for text in counts if text != "n = 5"] == [
        "(n = 5)",
        "(n = 5)",
        "(n = 4)",
    ]  # times of moves that were possible


def test_nothing_is_fetched(page):
    reader = Reader(page)
    for _, attributes in reader.elements:
        for name in ("src", "href", "action", "srcset", "data", "poster"):
            assert (attributes.get(name) or "data:").startswith("data:")
    without_pictures = re.sub(r"base64,[A-Za-z0-9+/=]+", "", page)
    assert not re.search(r"https?:|//[a-z]|url\(|@import", without_pictures.replace("// Numbers by", ""))
    (policy,) = [meta["content"] for meta in reader.all("meta") if meta.get("http-equiv")]
    assert policy.startswith("default-src 'none';")


def test_texts_stay_texts(page):
    """Wherever a name, a title, a status or a note ends up, it is read back as it was and makes no element."""
    reader = Reader(page)
    assert len(reader.all("script")) == 1
    assert not [image for image in reader.all("img") if image["src"] == "x"]
    assert not [name for _, attributes in reader.elements for name in attributes if name.startswith("on")]
    assert sum(HOSTILE in text for _, text in reader.texts) >= 6
    assert HOSTILE in [cell.get("data-value") for cell in reader.all("th")]


def test_a_task_without_distance_has_pictures_too(trials):
    bare = [{key: value for key, value in trial.items() if key != "distance"} for trial in trials]
    for trial in (ordinary_success(bare), worst_failure(bare)):
        assert "mm" not in _caption("what", trial)
        assert "goal" in _caption("what", trial)
    assert "mm" in _caption("success", {**bare[0], "distance": 0.001})
    lost = {"goal_index": 3, "distance": 0.0125, "posture_error": 0.25, "steps": 2, "impossible": True, "status": "ok"}
    assert _caption("worst", lost) == "worst · goal 3 · 12.5 mm · posture error 0.25 rad · 2 steps · ok"
    assert _caption("worst", {**lost, "steps": 1, "impossible_reason": "hit"}).endswith("0.25 rad · hit")


def test_an_ordinary_success_and_the_worst_failure_are_chosen(trials):
    distances = [trial | {"distance": 0.001 * n} for n, trial in enumerate(made_up("a", 5))]
    assert ordinary_success(distances)["goal_index"] == 2
    assert worst_failure(distances) is None
    hostile = [trial for trial in trials if trial["method"] == HOSTILE]
    assert ordinary_success(hostile) is None
    assert worst_failure(hostile)["goal_index"] == 4


#: Methods that decide at once, of every task of the package; of the button one that runs into the joints' limits.
QUICK = {
    "ur5": ["closed-form", "ppo-single"],
    "space": ["closed-form", "space-single"],
    "real-arm": ["data-sheet", "policy"],
    "moving": ["first-sight", "interception"],
    "arm3": ["closed-form", "lm"],
    "button": ["analytic", "random"],
    "obstacles": ["closed-form", "path"],
    "lift": ["closed-form", "placo"],
    "push": ["script", "random"],
    "pick-and-place": ["script", "random"],
}


def test_every_task_is_drawn_below():
    assert set(QUICK) == set(_OWN)


@pytest.mark.parametrize("name", QUICK)
@pytest.mark.slow
def test_every_task_has_pictures(name, needs_gl, tmp_path):
    compare(name, QUICK[name], goals=3, out=tmp_path)
    reader = Reader((tmp_path / "report.html").read_text())
    pictures = [image["src"] for image in reader.all("img") if image["src"].startswith("data:image/jpeg")]
    captions = reader.text("figcaption")
    results = json.loads((tmp_path / "results.json").read_text())
    failing = [method["name"] for method in results["methods"] if method["reached"] < 1]
    any_success = any(method["reached"] for method in results["methods"])
    drawn = (any_success + len(failing)) if name != "moving" else any_success  # which shows paths
    assert len(captions) == len(pictures) == drawn >= 1
    assert (tmp_path / "paths.png").exists() == (name == "moving")
    assert len(set(pictures)) == len(pictures)  # arm and ball are elsewhere in each
    with Image.open(tmp_path / "scene.png") as scene:
        assert np.asarray(scene).std() > 10


@pytest.mark.parametrize("name", ["arm3", *slow("real-arm", "button")])
def test_a_posture_beyond_the_limits_is_drawn(name, needs_gl):
    """A simulated joint is stopped by a spring: at the end of a trial it may be a little beyond its limit."""
    comparison = prepare(
        name, QUICK[name][:1], goals=1, seed=0, arm=None, observation=None, options=None, command=""
    )  # fmt: skip
    (trial,) = run_trials(comparison)
    arm = ArmKinematics(comparison.arm)
    drawn = [
        render_trials(comparison.task, [trial | {"q": q.tolist()}], results_of(comparison, [trial]))[0].image
        for q in (arm.upper, arm.upper + 1e-3, arm.upper - 1.0)
    ]
    beyond, away = (np.abs(image - drawn[0].astype(int)).mean() for image in drawn[1:])
    assert beyond < 0.1 * away


def test_what_cannot_be_drawn_is_said_and_a_mistake_is_raised(task, trials, results, tmp_path, needs_gl):
    write_report(tmp_path / "report.html", task, trials, results, {})
    assert "None: its environment has no `arm`, and the task has no `scene`" in (tmp_path / "report.html").read_text()

    def mistaken(env, trial):
        raise ValueError("a mistake")

    with pytest.raises(ValueError, match="a mistake"):
        write_report(tmp_path / "report.html", replace(task, scene=mistaken), trials, results, {})


def test_what_is_under_failures_is_said_in_each_case(task, trials, results):
    """In the words of what hinders, for tasks with a figure of paths, and where no failure is left to be drawn."""
    black = np.zeros((9, 16, 3), dtype=np.uint8)
    worst, good = Rendering(HOSTILE, "a failure", black), Rendering("lm", "a success", black, True)
    every = {**results, "methods": [{**method, "reached": 1} for method in results["methods"]]}
    with_paths = replace(task, paths=lambda *_: None)
    for own, found, entries, said in (
        (task, "no library", results, "no library"),
        (task, [good], every, "None: every method reached every goal."),
        (with_paths, [good], results, "How episodes go is shown by the paths above."),
        (task, [worst], results, "The worst one opens this report."),
        (task, [], results, "None is drawn."),
        (task, [good, worst], results, "The worst failure of each method that has one."),
    ):
        assert said in Reader(report_html(own, trials, entries, {}, found)).text("p"), said


@pytest.mark.parametrize("error", [InstallationError("no library"), DrawingError("no memory")])
def test_without_pictures_a_sentence_says_why(error, task, trials, results, tmp_path, monkeypatch):
    def fails(*_):
        raise error

    monkeypatch.setattr("kinreach.compare._report.render_trials", fails)
    write_report(tmp_path / "report.html", task, trials, results, {})
    assert f"None: {error}" in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "scene.png").exists()


PROBE = """<!doctype html><link rel="icon" href="data:,"><iframe src="report.html" width="1400"></iframe>
<pre id="seen"></pre>
<script>
addEventListener("load", () => {
  const inside = document.querySelector("iframe").contentDocument;
  const heads = [...inside.querySelectorAll("table.sortable thead th")];
  const rows = () => [...inside.querySelectorAll("table.sortable tbody tr:not(.part)")];
  const names = () => rows().map((row) => row.cells[0].textContent.length);
  const seen = [names()];
  for (const column of [0, 0, heads.findIndex((head) => head.textContent.startsWith("distance"))]) {
    heads[column].querySelector("button").click();
    seen.push([...names(), heads[column].getAttribute("aria-sort")]);
  }
  const move = heads.findIndex((head) => head.textContent.startsWith("move"));
  for (const _ of [0, 1]) { heads[move].querySelector("button").click(); seen.push(names()); }
  seen.push(inside.querySelectorAll("[aria-sort]").length, inside.images.length);
  seen.push([...inside.querySelectorAll("div.wide")].every((box) => box.scrollWidth <= box.clientWidth));
  seen.push([...inside.querySelectorAll("a[download]")].map((link) => link.href.slice(0, 15)));
  document.getElementById("seen").textContent = JSON.stringify(seen);
  console.warn("the probe is done");
});
</script>"""


@contextmanager
def served(folder):
    """A server of the loopback interface for a folder: its address, and the paths that were asked for."""
    asked = []

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_):
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


@pytest.mark.slow
def test_in_a_browser(page, browser_path, tmp_path):
    """It opens without a message on the console or a request, clicks on headings sort the table, no column hides."""
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "report.html").write_text(page, encoding="utf-8")
    (folder / "probe.html").write_text(PROBE, encoding="utf-8")
    with served(folder) as (address, asked):
        command = [
            browser_path, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}",
            "--enable-logging=stderr", "--virtual-time-budget=10000", "--dump-dom", f"{address}/probe.html",
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
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
        f"[{closed},{lm},{hostile}],[{closed},{lm},{hostile}],1,4,"  # by time: all equal, the order stays
        'true,["data:image/png;","data:image/png;"]]'  # every column is in sight at 1400 px; figures can be saved
    )


def test_the_report_is_as_it_was(page):
    """But for pictures and how it was measured; `KINREACH_KEEP=1` keeps it as it is now."""
    measured = r"base64,[A-Za-z0-9+/=]+|sha256-[^']*|<(style|script|dd)>.*?</(style|script|dd)>"
    body = re.sub(measured, "", page, flags=re.DOTALL).replace(date.today().isoformat(), "DATE")
    kept = Path(__file__).parents[1] / "data" / "report.html"
    if os.environ.get("KINREACH_KEEP"):
        kept.write_text(body, encoding="utf-8")
    assert body.splitlines() == kept.read_text(encoding="utf-8").splitlines()
