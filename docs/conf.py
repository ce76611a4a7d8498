"""Settings of Sphinx for the site, which `make site` builds from what site_stage.py lays out."""

import re
import sys
from pathlib import Path
from typing import Any

from duobench.core.versions import __version__

sys.path.append(str(Path(__file__).parent))

project = "DuoBench"
author = "The DuoBench authors"
copyright = "the DuoBench authors, Apache-2.0"
release = version = __version__

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
source_suffix = {".md": "markdown"}
exclude_patterns = ["files/**"]

# Pages are Markdown as a code host shows it: headings are anchors, colons may fence.
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

# Docstrings are in Google's style; a name between single backticks is code.
default_role = "code"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
add_module_names = False
toc_object_entries_show_parents = "hide"

smartquotes = False  # two hyphens are an option, and quotes are those of the code

html_theme = "furo"
html_title = f"DuoBench {release}"
html_copy_source = False
html_domain_indices = False
html_show_sourcelink = False
html_static_path = ["site_static"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": False, "top_of_page_buttons": []}

EXAMPLES = dict(
    re.findall(
        r"^## (\S+)\n(.*?)(?=^## |\Z)",
        (Path(__file__).parent / "site_examples.txt").read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
)
"""Examples of the Python API by name, as an interpreter shows them; a test runs each."""
KEPT: list[str] = []
"""What is said of an attribute, while napoleon reads it."""
FIELDS = {"attribute", "data", "property"}


def keep(*told: Any) -> None:
    """Remember what is said of an attribute: napoleon takes what precedes a colon for its type."""
    if told[1] in FIELDS:
        KEPT[:] = list(told[-1])


def give_back(*told: Any) -> None:
    """Say it again."""
    if told[1] in FIELDS:
        told[-1][:] = KEPT


def show_example(*told: Any) -> None:
    """Add the example of a name to what is said of it."""
    name, lines = told[2], told[-1]
    lines += ["", *EXAMPLES.get(name, "").splitlines(), ""]


def show_signature(*told: Any) -> tuple[str | None, str | None]:
    """Shorten defaults that are no Python, which Sphinx could not read."""
    signature, returns = told[-2:]
    return signature and re.sub(r"<[^<>]*>", "...", signature), returns


def setup(app: Any) -> None:
    """Be called before and after napoleon."""
    app.connect("autodoc-process-signature", show_signature)
    for call, priority in ((keep, 1), (give_back, 999), (show_example, 1000)):
        app.connect("autodoc-process-docstring", call, priority=priority)
