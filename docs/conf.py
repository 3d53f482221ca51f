"""How Sphinx builds these pages: `make docs`. Nothing is fetched from the network, and no notebook is executed."""

from __future__ import annotations

import importlib.util
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import scipy.stats  # noqa: E402, F401 (it computes on import, which a mocked torch would break)
from sphinx.search.en import SearchEnglish  # noqa: E402

import kinreach  # noqa: E402

project = "kinreach"
author = "the kinreach authors"
release = version = kinreach.__version__
html_title = "kinreach"

#: Links to the sources, "Edit this page" and the repository's icon appear when `[project.urls]` of pyproject.toml has
#: `Repository = "https://github.com/OWNER/kinreach"`; `html_baseurl` is its `Documentation`.
urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("urls", {})
repository = urls.get("Repository", "").rstrip("/")
html_baseurl = urls.get("Documentation", "")

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "_site",
]
exclude_patterns = ["_*"]

nb_execution_mode = "off"  # notebooks are shown with the outputs that they have
nb_ipywidgets_js = {}
myst_heading_anchors = 4
myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "dollarmath"]
myst_url_schemes = ["http", "https"]
html_math_renderer = "mathml"

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("ArrayLike", "Floats", "Accept", "Goal", "RewardFunction")}
autodoc_typehints_format = "short"
#: What the extras bring is not needed to build these pages.
autodoc_mock_imports = [name for name in ("stable_baselines3", "torch", "viser") if not importlib.util.find_spec(name)]
default_role = "py:obj"  # `name` in a docstring: a link where there is such a name, code elsewhere
python_use_unqualified_type_names = True
maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False
toc_object_entries_show_parents = "hide"

#: Inventories with the few names that these pages link to, as text (version 1 of the format).
intersphinx_mapping = {
    name: (url, f"_inventories/{name}.txt")
    for name, url in {
        "gymnasium": "https://gymnasium.farama.org/",
        "numpy": "https://numpy.org/doc/stable/",
        "python": "https://docs.python.org/3/",
        "stable-baselines3": "https://stable-baselines3.readthedocs.io/en/master/",
    }.items()
}

html_theme = "furo"
pygments_dark_style = "github-dark"
html_static_path = ["_static"]
html_css_files = ["site.css"]
SearchEnglish.stopwords = SearchEnglish.stopwords - {"her"}  # HER is found, too
html_search_scorer = str(ROOT / "docs" / "_search.js")
html_logo = html_favicon = "_static/logo.svg"
html_copy_source = html_show_copyright = False
html_theme_options = {
    "source_repository": repository,
    "source_branch": "main",
    "source_directory": "docs/",
    "sidebar_hide_name": False,
    "top_of_page_buttons": ["view", "edit"] if repository else [],
}
