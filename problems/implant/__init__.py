"""From the mesh files of a real knee implant to the poses of measured cycles.

Run ``python -m problems.implant --help``.
"""

from pathlib import Path

SCENE = Path(__file__).with_name("tka_mesh.toml")

__all__ = ["SCENE"]
