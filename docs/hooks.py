"""What MkDocs does not do by itself: files of the repository among the pages, the README's tables, MathML."""

import re
from html import unescape
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]

SHOWN = ("CHANGELOG.md", "CONTRIBUTING.md", "dataset_cards/*.md", "examples/paper_table/*.md", "examples/**/*.png")
"""Files beside ``docs/`` that are pages and pictures of the site, under the paths that they have in the repository."""

TABLE = re.compile(r"<!-- (\w+): the README's -->")
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
OWN_PAGE = re.compile(r"\]\(((?:\.\./)*)docs/")
"""A link to a page of ``docs/``, whose folder the site does not have."""

CITATION = re.compile(r"docs/([a-z_]+)\.md(?:#([a-z0-9-]+))?")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the files of ``SHOWN``."""
    for pattern in SHOWN:
        for path in sorted(ROOT.glob(pattern)):
            files.append(File.generated(config, path.relative_to(ROOT).as_posix(), abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Inserts the README's tables, and lets links to and from files beside ``docs/`` hold as in the repository."""
    markdown = OWN_PAGE.sub(r"](\1", markdown)
    if "/" in page.file.src_uri:
        return markdown
    return TABLE.sub(lambda found: _table(found[1]), markdown.replace("](../", "]("))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turns formulas into MathML, and citations in docstrings into links."""
    html = FORMULA.sub(_formula, html)
    return CITATION.sub(lambda cited: _link(cited, page, files), html) if page.file.src_uri.startswith("api/") else html


def _table(name: str) -> str:
    readme = (ROOT / "README.md").read_text()
    return re.search(rf"<!-- {name}: .*?-->\n(.*?)<!-- end of {name} -->", readme, re.DOTALL)[1]


def _formula(found: re.Match) -> str:
    mathml = convert(unescape(found[2]), display="block" if found[1] == "div" else "inline")
    if "\\" in mathml:
        raise PluginError(f"latex2mathml does not know all of {found[2]!r}.")
    return mathml


def _link(cited: re.Match, page: Page, files: Files) -> str:
    url = files.get_file_from_path(f"{cited[1]}.md").url_relative_to(page.file)
    return f'<a href="{url}{"#" + cited[2] if cited[2] else ""}">{cited[0]}</a>'
