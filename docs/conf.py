"""The documentation site: Sphinx with the theme Furo; `make docs` builds it strictly into out/site."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

import site_reference  # noqa: E402  (of tools/)

import poise  # noqa: E402

project = "Poise"
copyright = "the Poise authors, Apache-2.0"
release = version = poise.__version__
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.mermaid",
]
exclude_patterns = ["scenes", "pictures"]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_fence_as_directive = ["mermaid"]
myst_heading_anchors = 4
smartquotes = False  # two hyphens of an option stay two
nb_execution_mode = "off"  # test/test_notebooks.py executes them; the site shows the outputs that are stored in them
suppress_warnings = ["myst.header", "misc.highlighting_failure", "ref.python"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
python_maximum_signature_line_length = 88
python_display_short_literal_types = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "furo"
html_title = f"Poise {release}"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_theme_options = {"navigation_with_keys": True, "top_of_page_buttons": []}

ELSEWHERE = {
    "SECURITY.md": "project/security_policy.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "CHANGELOG.md": "project/changelog.md",
    "bags/README.md": "project/recordings.md",
    "benchmarks/real/README.md": "project/real_recordings.md",
}
"""Files outside of docs/ that are pages of the site."""


def setup(app: object) -> None:
    """Write the pages of the reference that follow from the code, before Sphinx looks for pages."""
    site_reference.connect(app, Path(__file__).parent / "reference" / "generated", ELSEWHERE)
