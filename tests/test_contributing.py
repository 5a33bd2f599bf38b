"""What CONTRIBUTING.md names exists."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_every_file_that_it_names_exists() -> None:
    targets = re.findall(r"\]\(([^)]+)\)", TEXT)
    assert len(targets) > 40
    assert [target for target in targets if not (ROOT / target).exists()] == []
    named = re.findall(r"(?<![\w/.])(?:tests|\.ci)/[\w./]+", TEXT)
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_every_folder_of_the_package_is_in_the_layout() -> None:
    layout = TEXT.split("## Layout")[1].split("\n## ")[0]
    folders = {
        path.name for path in (ROOT / "bussim").iterdir() if path.is_dir() and path.name != "__pycache__"
    }
    assert folders == set(re.findall(r"\(bussim/(\w+)\)", layout)) & folders


def test_every_table_and_class_that_it_names_exists() -> None:
    assert "COMMANDS" in (ROOT / "bussim/cli.py").read_text(encoding="utf-8")
    assert "class Profile" in (ROOT / "bussim/plc/profiles.py").read_text(encoding="utf-8")
    assert "def to_json" in (ROOT / "bussim/exact/sizing/size.py").read_text(encoding="utf-8")
