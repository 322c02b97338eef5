"""``report.html``: what surrogates of a scene are fit for, where they were sampled, and how wrong they are."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.reading import one_line
from casadi_contact.pictures.charts import draw_speed_accuracy
from casadi_contact.pictures.contact_picture import contact_pose, draw_contact
from casadi_contact.pictures.page import save_page
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate

if TYPE_CHECKING:
    from casadi_contact.workflow.benchmark.front_file import Front

_PAGE = """\
<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<title>casadi_contact: {scene}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 75rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
h1 {{ font-size: 1.5rem; }} h2 {{ font-size: 1.15rem; margin-top: 2rem; }} pre {{ font-size: 12px; overflow-x: auto; }}
.verdict {{ font-size: 1.1rem; border-left: 4px solid #0072b2; padding: 0.3rem 0.8rem; background: #f0f6fa; }}
.unfit {{ border-color: #d55e00; background: #fdf3ec; }} img {{ max-width: 100%; }}
</style>
</head>
<body>
{body}
</body>
</html>
"""


def surrogate_page(
    surrogates: Mapping[str, Surrogate], samples: Samples | None = None, front: Front | None = None
) -> str:
    """HTML of surrogates of one scene by name; samples that they learned from, and the scene's measured chart, if any.
    Everything else comes from the surrogates' own files. It loads nothing and runs nothing."""
    scene = next(iter(surrogates.values())).scene
    verdicts = {name: surrogate.info().fitness for name, surrogate in surrogates.items()}
    chart = "No chart was measured for this scene: casadi-contact chart does."
    parts = [
        _element("h1", f"Surrogates of the scene {scene.name}"),
        *(_element("p", f"{n}: {of}", "verdict" if of.usable else "verdict unfit") for n, of in verdicts.items()),
        _element("h2", "Scene"),
        _scene_picture(scene),
        *(_element("h2", n) + _element("pre", f"{surrogate.info()}") for n, surrogate in surrogates.items()),
        _element("h2", "Dropped samples"),
        _element("pre", _dropped(samples)),
        _element("h2", "Speed and accuracy"),
        _element("p", chart)
        if front is None
        else _picture(lambda path: save_page(draw_speed_accuracy(front), path), "time per pose against error"),
    ]
    return _PAGE.format(scene=escape(scene.name), body="\n".join(parts))


def _element(tag: str, text: str, kind: str = "") -> str:
    """An element of this text; kind: of the style sheet."""
    return f'<{tag} class="{kind}">{escape(text)}</{tag}>'


def _picture(draw: Callable[[Path], object], said: str) -> str:
    """A PNG inside the page; draw writes it to a path."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{escape(said)}" src="data:image/png;base64,{data}">'


def _scene_picture(scene: Scene) -> str:
    """The bodies in contact; or in words why there is no picture."""
    try:
        model = ElasticFoundation(scene)
        pose = contact_pose(model)
    except (ValueError, OSError, ImportError) as error:
        return _element("p", f"no picture: {one_line(error)}")
    return _picture(lambda path: draw_contact(model, np.array([pose]), path), f"{scene.name} in contact")


def _dropped(samples: Samples | None) -> str:
    """Why samples of a plan were dropped, a line for each domain."""
    if samples is None:
        return "No samples of this scene lie beside the surrogates: what was dropped is not known here."
    shares = samples.dropped_shares().items()
    lines = [f"{d} {share:.1%} of the plan: {samples.dropped_reasons(d) or '-'}" for d, share in shares if share]
    return "\n".join(lines) or "None."
