"""Metadata that depend on where the project is found: its addresses, and the long description.

Links and pictures of the README are relative, for readers of a checkout; on a package index they
need whole addresses.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

HERE = Path(__file__).parent
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)]+)\)")


class ReleaseMetadata(MetadataHookInterface):
    """Fills in `urls` and `readme`."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Adds both to what `pyproject.toml` says."""
        release = runpy.run_path(str(HERE / "emvs" / "utils" / "release.py"))
        repository = release["REPOSITORY"]
        urls = {"Documentation": release["DOCUMENTATION"], "Repository": repository}
        if repository:
            urls["Issues"] = f"{repository}/issues"
            urls["Changelog"] = f"{repository}/blob/main/CHANGELOG.md"
        metadata["urls"] = {name: address for name, address in urls.items() if address}
        text = with_whole_addresses((HERE / "README.md").read_text("utf-8"), repository)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def with_whole_addresses(text: str, repository: str) -> str:
    """Markdown whose relative links lead into the repository, and pictures to their bytes.

    Without a repository links become their words, and pictures are left out.
    """

    def whole(found: re.Match[str]) -> str:
        mark, words, target = found.groups()
        if not repository:
            return "" if mark else words
        return f"{mark}[{words}]({repository}/{'raw' if mark else 'blob'}/main/{target})"

    # A picture may be the words of a link: pictures first.
    text = re.sub(r"!\[[^\]]*\]\([^)]+\)", lambda one: LINK.sub(whole, one[0]), text)
    return LINK.sub(whole, text)
