"""Sections of a document that are written by a command."""

import pytest

from lerobot_gcdt.hub.documents import read_section, write_section

DOCUMENT = "# Title\n<!-- rates: written by x.py -->\nold\n<!-- end of rates -->\nThe end.\n"


def test_a_section_is_replaced_and_the_rest_stays(tmp_path):
    (tmp_path / "page.md").write_text(DOCUMENT)
    write_section(tmp_path / "page.md", "rates", "| a |\n| b |\n")
    assert (tmp_path / "page.md").read_text() == DOCUMENT.replace("old\n", "| a |\n| b |\n")
    assert read_section(tmp_path / "page.md", "rates") == "| a |\n| b |\n"


def test_a_missing_section_is_named(tmp_path):
    (tmp_path / "page.md").write_text(DOCUMENT)
    with pytest.raises(ValueError, match="page.md has no section <!-- tasks:"):
        write_section(tmp_path / "page.md", "tasks", "new\n")
