"""The live page of the knee, written anew whenever the docs are built: ``how-to/joint-page.md`` links to it."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from casadi_contact.pictures.live.joint_page import write_joint_page

PAGE = "how-to/knee.html"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page to the site (a hook of MkDocs)."""
    files.append(File.generated(config, PAGE, content=_knee()))
    return files


@cache
def _knee() -> str:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "knee.html"
        write_joint_page("knee", path)
        return path.read_text("utf-8")
