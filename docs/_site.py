"""What these pages need beside Sphinx's extensions.

Formulas without a script, docstrings with Markdown in them, constants that a package re-exports, notebooks, the code of
examples, and numbers in tables.
"""

from __future__ import annotations

import re
import shutil
import sys
import zlib
from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from PIL import Image
from sphinx.application import Sphinx
from sphinx.config import Config
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer
from sphinx.transforms.post_transforms import SphinxPostTransform
from sphinx.util.inspect import TypeAliasForwardRef
from sphinx.writers.html5 import HTML5Translator

#: A cell of a table that is a number, with its interval, unit or sign.
NUMBER = re.compile(
    r"^(above |below )?[-−+±<>≤≥~≈]?\s?"
    r"(π|–(\s?\[.*\])?|\d[\d\s.,eE:–/×x*^-]*(%|[a-zA-Zµ°²/³]{1,6})?\s?(\[.*\]|\(.*\)|±.*)?)$"
)
#: Columns with a cell of so many characters stay wide, by the class of their cells.
WIDE = {"longer": 180, "long": 60}
#: Columns without a longer cell do not break, and may be narrow on a phone.
SHORT = 14
#: What a column of sentences needs at least, in characters, on a phone and on a page, and what is between columns.
SENTENCE, BETWEEN = (12, 20), 3
#: With more than that in all, a table's rows are stacked on a phone, and intervals stand below the numbers on a page.
ROOM = (49, 80)
#: A figure is a chart if more than this share of its pixels is at least so bright, of 255.
WHITE_SHARE, NEAR_WHITE = 0.55, 250
#: Rendered on white: not a chart.
RENDERED = "frames.png"
#: Charts that are wider than high and have at least so many pixels keep readable letters on a phone, where they scroll;
#: those of the thesis's page are drawn for it.
BROAD, FOR_A_PHONE = 700, "/thesis/"
#: So are these maps, whose cells cover more.
MAPS = ("lift_beyond.png", "off_volume.png")
#: An interval after a number, as in `97 % [95, 99]`.
INTERVAL = re.compile(r"\[[-−+\d][^\[\]]*\]")
#: Numbers of several seeds, as in `99.7, 99.6, 99.4`.
SEEDS = re.compile(r"[-−]?[\d.]+(, [-−]?[\d.]+){2,5}")
#: Code in a line of a docstring, or a bar, which reStructuredText takes for a substitution.
BAR = re.compile(r"(`+[^`]*`+)|\|")
#: Commands, tags, and words that a line may break within at a hyphen or bracket, of at most so many characters.
COMMANDS = re.compile(r'<div class="highlight-bash.*?</pre>', re.DOTALL)
TAG, BREAKABLE, WHOLE = re.compile(r"(<[^>]*>)"), re.compile(r"[^\s<>]*[-\[][^\s<>]*"), 36
#: Code in a line whose words are at most so long does not break in them.
BRIEF = 30
#: A space between groups of three digits, as in `76 800`, or before a unit.
UNBROKEN = re.compile(r"(?<=\d) (?=(?:\d{3}(?!\d)|(?:%|[cmµ]?m|[mµu]?s|m/s|episodes/s|k?g|N|rad|Hz)(?![\w/])))")


def setup(app: Sphinx) -> dict[str, int]:
    """Called by Sphinx, which reads all pages again when this file has changed."""
    TypeAliasForwardRef.__repr__ = lambda alias: alias.name  # type: ignore[method-assign]
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    app.add_post_transform(Numbers)
    app.add_post_transform(Charts)
    app.connect("autodoc-process-signature", _plain_signature)
    app.connect("autodoc-skip-member", _field_of_tuple)
    app.connect("autodoc-process-docstring", _comment_of_constant, priority=300)
    app.connect("autodoc-process-docstring", _from_markdown, priority=400)  # before napoleon
    app.connect("autodoc-process-docstring", _two_in_one, priority=600)  # after it
    app.connect("config-inited", _copy_notebooks)
    app.connect("html-page-context", _whole_words)
    app.connect("source-read", _links_of_notebooks)
    app.connect("source-read", _code_of_examples)
    version = zlib.crc32(Path(__file__).read_bytes())
    return {"env_version": version, "parallel_read_safe": True, "parallel_write_safe": True}


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(tex2mathml(node.astext(), as_block=True))
    raise nodes.SkipNode


def _plain_signature(
    app: Sphinx, what: str, name: str, value: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    """What a dataclass makes anew, and a function without a name, as an ellipsis; protocols without arguments."""
    if arguments == "(*args, **kwargs)":
        arguments = ""
    plain = [
        text and re.sub(r"<factory>|<function [\w.]*<lambda>>", "...", re.sub(r"<function (\w+)>", r"\1", text))
        for text in (arguments, returned)
    ]
    return plain[0], plain[1]


def _field_of_tuple(app: Sphinx, what: str, name: str, value: Any, skip: bool, options: Any) -> bool | None:
    """Leave out fields that the class describes, and of which Python says "Alias for field number 0"."""
    return True if (getattr(value, "__doc__", None) or "").startswith("Alias for field number") else None


def _comment_of_constant(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """A constant has its `#:` comment where it is defined, not where its package exports it."""
    if what != "data":
        return
    package, _, constant = name.rpartition(".")
    lines.clear()
    for module in sorted(module for module in sys.modules if module.startswith(f"{package}.")):
        try:
            docs = ModuleAnalyzer.for_module(module).find_attr_docs()
        except PycodeError:
            continue
        if ("", constant) in docs:
            lines.extend(docs["", constant])
            return


def _from_markdown(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Headings, tables and indented code of a docstring as reStructuredText."""
    found = list(lines)
    lines[:] = ["..", ""] if what == "property" else []  # or napoleon takes what is before a colon for a type
    code = False
    for before, line, after in zip(["", *found], found, [*found[1:], ""], strict=False):
        text = next((earlier for earlier in reversed(lines) if earlier), " ")
        if line.startswith("    ") and not before and text[0] != " ":
            lines += [] if text.startswith(".. ") else ["::", ""]
            code = True
        code = code and (not line or line[0] == " ")
        if line.startswith("## "):
            lines += [f".. rubric:: {line[3:]}", ""]
        elif line.startswith("|") and after.startswith("|--"):
            lines += [".. list-table::", "   :header-rows: 1", "", *_row(line)]
        elif line.startswith("|"):
            lines += [] if line.startswith("|--") else _row(line)
        else:
            lines.append(line if code else BAR.sub(lambda found: found[1] or "\\|", line))


def _two_in_one(app: Sphinx, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """`lower, upper: Limits` describes two; Sphinx would take the first for the type of the second."""
    for number, line in enumerate(lines):
        if found := re.match(r":(ivar|param) (\w+(?:, \w+)+):", line):
            lines[number] = f":{found[1]} {found[2].replace(' ', '')}:{line[found.end() :]}"


def _row(line: str) -> list[str]:
    cells = line.strip("| ").split(" | ")
    return [f"   {'*' if not number else ' '} - {cell.strip()}" for number, cell in enumerate(cells)]


def _copy_notebooks(app: Sphinx, config: Config) -> None:
    """Sphinx reads pages below its folder only."""
    folder = app.srcdir / "studies/notebooks"
    folder.mkdir(exist_ok=True)
    for notebook in app.srcdir.parent.glob("notebooks/*.ipynb"):
        shutil.copy2(notebook, folder)


def _links_of_notebooks(app: Sphinx, docname: str, source: list[str]) -> None:
    """Notebooks are not where their copies are; in them a link to a file of the package becomes its name."""
    if docname == "studies/notebooks":  # not in the source, where GitHub would show the directive
        source[0] += "\n```{toctree}\n:hidden:\n:glob:\n\nnotebooks/*\n```\n"
    source[0] = re.sub(r"\]\((?:\.\./)+notebooks/(?=\w+\.ipynb)", "](/studies/notebooks/", source[0])
    if docname.startswith("studies/notebooks/"):
        source[0] = re.sub(r"\]\(\.\./docs/", "](../../", source[0])
        source[0] = re.sub(r"\[([^\]\n]+)\]\((?:\.\./(?!\.\./)[^)\n]*|figures)\)", r"\1", source[0])


def _code_of_examples(app: Sphinx, docname: str, source: list[str]) -> None:
    """Where the sources link to an example, the site has its code."""
    shown = r"\1\n\n```{literalinclude} /../\2\n:language: python\n```"
    source[0] = re.sub(r"^\[(`python examples/\w+\.py`)\]\((?:\.\./)+(.*?)\)$", shown, source[0], flags=re.MULTILINE)


def _whole_words(
    app: Sphinx, page: str, template: str, context: dict[str, Any], doctree: nodes.document | None
) -> None:
    """A command breaks between its words, not within an option (`site.css`)."""

    def whole(word: re.Match[str]) -> str:
        return f'<span class="whole">{word[0]}</span>' if len(word[0]) <= WHOLE else word[0]

    def block(commands: re.Match[str]) -> str:
        parts = TAG.split(commands[0])
        return "".join(part if part.startswith("<") else BREAKABLE.sub(whole, part) for part in parts)

    if "body" in context:
        context["body"] = COMMANDS.sub(block, context["body"])


class Numbers(SphinxPostTransform):
    """Numbers do not break; columns of them are right-aligned, intervals small and grey (`site.css`)."""

    default_priority = 200
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """Join groups of digits and units, and mark the cells of every table."""
        for text in list(self.document.findall(nodes.Text)):
            if UNBROKEN.search(text) and not isinstance(text.parent, nodes.literal | nodes.literal_block):
                text.parent.replace(text, nodes.Text(UNBROKEN.sub("\N{NO-BREAK SPACE}", text)))
        for code in self.document.findall(nodes.literal):
            code["classes"] += ["brief"] * (max(map(len, code.astext().split()), default=0) <= BRIEF)
        for table in self.document.findall(nodes.table):
            before = table.previous_sibling()
            table["classes"] += ["data"] * bool(before and before.astext().startswith("<!-- table "))  # `tables.py`
            rows = [list(row.findall(nodes.entry)) for row in table.findall(nodes.row)]
            for column in zip(*rows, strict=False):
                texts = [cell.astext().strip() for cell in column[1:]]
                number = any(texts) and all(not text or text in "–—-" or NUMBER.match(text) for text in texts)
                longest = max(map(len, texts), default=0)
                short = longest <= SHORT or (number and not any(map(INTERVAL.search, texts)))
                classes = [name for name, least in WIDE.items() if longest >= least][:1]
                for cell in column:
                    seeds = bool(SEEDS.fullmatch(cell.astext().strip()))
                    cell["classes"] += ["number"] * number + ["short"] * (short or seeds) + classes
            _stack(table, rows)
            for text in list(table.findall(nodes.Text)):
                if INTERVAL.search(text) and not isinstance(text.parent, nodes.literal):
                    _mark_intervals(text)


def _stack(table: nodes.table, rows: list[list[nodes.entry]]) -> None:
    """Give every cell its column's heading, if a phone has no room for the columns (`site.css`)."""
    headings, *cells = rows
    columns = [[cell.astext().strip() for cell in column] for column in zip(*cells, strict=False)]
    below = [[INTERVAL.sub("", text) for text in column] for column in columns]  # where intervals stand below
    phone, page = (
        sum(BETWEEN + _least(column, sentence) for column in one)
        for one, sentence in zip((below, columns), SENTENCE, strict=True)
    )
    table["classes"] += ["stack"] * (phone > ROOM[0]) + ["wide"] * (page > ROOM[1])
    for row in cells if phone > ROOM[0] and len(headings) > 2 else []:
        for heading, cell in zip(headings[1:], row[1:], strict=False):
            if cell.astext().strip() and heading.astext().strip():
                formula = [part.deepcopy() for part in heading[0]] if any(heading.findall(nodes.math)) else []
                text = "" if formula else heading.astext().strip()
                cell.insert(0, nodes.inline("", text, *formula, classes=["heading"]))


def _least(column: list[str], sentence: int) -> int:
    """Return how many characters a column needs: its longest word, and all of what is shorter than a sentence."""
    return max((max(min(len(text), sentence), *map(len, text.split() or [""])) for text in column), default=0)


class Charts(SphinxPostTransform):
    """Figures that are mostly white get the class `chart`; they are inverted where pages are dark (`site.css`)."""

    default_priority = 200
    formats = ("html",)

    def run(self, **kwargs: Any) -> None:
        """Mark the images of a page."""
        for image in self.document.findall(nodes.image):
            if image["uri"].endswith(".png"):
                picture = Image.open(self.app.srcdir / image["uri"]).convert("L")
                light = picture.histogram()[NEAR_WHITE:]
                white = sum(light) > WHITE_SHARE * picture.width * picture.height
                chart = (white and not image["uri"].endswith(RENDERED)) or image["uri"].endswith(MAPS)
                broad = picture.width >= max(BROAD, picture.height) and FOR_A_PHONE not in image["uri"]
                image["classes"] += ["chart"] * chart + ["broad"] * (chart and broad)


def _mark_intervals(text: nodes.Text) -> None:
    parts: list[nodes.Node] = []
    end = 0
    for match in INTERVAL.finditer(text):
        parts += [nodes.Text(text[end : match.start()]), nodes.inline("", match[0], classes=["interval"])]
        end = match.end()
    text.parent.replace(text, [*parts, nodes.Text(text[end:])])
