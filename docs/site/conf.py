"""The pages of docs/ as a site of static files:  sphinx-build -W -c docs/site docs build/site

MyST follows links: pages to pages, source files and pictures to copies that lie beside them. `-W` ends the build where
a link leads nowhere.
"""

import re
from pathlib import Path

from sphinx.application import Sphinx

project = "JouleSwarm"
author = "The JouleSwarm authors"
project_copyright = "Apache-2.0"
extensions = ["myst_parser", "sphinx_copybutton"]
myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]  # of languages that have no colours there, such as csv
html_theme = "furo"  # its fonts are the reader's own; nothing is fetched from elsewhere
html_title = "JouleSwarm"
html_show_sphinx = False


def setup(app: Sphinx) -> None:
    """README.md is the first page."""
    app.connect("include-read", from_the_root)


def from_the_root(app: Sphinx, path: Path, page: str, content: list[str]) -> None:
    """Links of pages that lie a folder above docs/: to each other's pages here, and to what else is there."""
    led = re.sub(r"\]\((CONTRIBUTING|CHANGELOG)\.md", lambda link: f"](docs/{link[1].lower()}.md", content[0])
    led = re.sub(r"\]\((?!docs/|[a-z]+:|#)", "](../", led)
    content[0] = re.sub(r"\]\(docs/", "](", led)
