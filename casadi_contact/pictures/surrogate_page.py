"""``report.html``: what surrogates of a scene are fit for, where they were sampled, and how wrong they are."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.files.reading import one_line
from casadi_contact.core.quantities import quantity, three_digits
from casadi_contact.pictures.charts import draw_speed_accuracy
from casadi_contact.pictures.contact_picture import contact_pose, draw_contact
from casadi_contact.pictures.page import save_page
from casadi_contact.samples.samples import Samples
from casadi_contact.scenes.scene import Scene
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.info import model_line, other_rows

if TYPE_CHECKING:
    from casadi_contact.workflow.benchmark.front_file import Front

_STYLE = """\
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
table { border-collapse: collapse; margin: 0.5rem 0; } td, th { padding: 0.15rem 0.6rem; text-align: right; }
th { border-bottom: 1px solid #888; } td:first-child, th:first-child { text-align: left; }
tr:nth-child(even) td { background: #f4f4f4; } .high { color: #b03000; font-weight: bold; }
.verdict { font-size: 1.1rem; border-left: 4px solid #0072b2; padding: 0.3rem 0.8rem; background: #f0f6fa; }
.unfit { border-color: #d55e00; background: #fdf3ec; } img { max-width: 100%; }
"""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # a reader of the file loads nothing either


def heading(text: str, level: int = 2) -> str:
    """A heading."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """A paragraph; kind: of the style sheet."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def table(columns: Sequence[str], rows: Sequence[Sequence[str]], high: Callable[[int, int], bool] | None = None) -> str:
    """A table; high: is the cell (row, column) one that stands out?"""

    def cell(i: int, j: int, text: str) -> str:
        return f'<td class="high">{escape(text)}</td>' if high and high(i, j) else f"<td>{escape(text)}</td>"

    head = "".join(f"<th>{escape(column)}</th>" for column in columns)
    body = "\n".join(
        f"<tr>{''.join(cell(i, j, text) for j, text in enumerate(row))}</tr>" for i, row in enumerate(rows)
    )
    return f"<table>\n<tr>{head}</tr>\n{body}\n</table>"


def picture(draw: Callable[[Path], object], said: str) -> str:
    """A PNG inside the page; draw writes it to a path."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        draw(path)
        data = base64.b64encode(path.read_bytes()).decode("ascii")
    return f'<img alt="{escape(said)}" src="data:image/png;base64,{data}">'


def surrogate_page(
    surrogates: Mapping[str, Surrogate], samples: Samples | None = None, front: Front | None = None
) -> str:
    """HTML of surrogates of one scene by name; samples that they learned from, and the scene's measured chart, if any.
    Everything else comes from the surrogates' own files."""
    scene = next(iter(surrogates.values())).scene
    parts = [heading(f"Surrogates of the scene {scene.name}", 1)]
    for name, surrogate in surrogates.items():
        verdict = surrogate.info().fitness
        parts.append(paragraph(f"{name}: {verdict}", "verdict" if verdict.usable else "verdict unfit"))
    parts += [heading("Scene"), _scene_picture(scene)]
    for name, surrogate in surrogates.items():
        tolerances, errors = surrogate.scene.tolerances, surrogate.info().test_errors
        parts += [heading(f"{name}: reach"), *_reach(surrogate), heading(f"{name}: errors by domain")]
        parts += [_errors(errors, surrogate.load_names, tolerances), heading(f"{name}: coverage"), _coverage(surrogate)]
        parts += [heading(f"{name}: training"), _training(surrogate)]
    parts += [heading("Dropped samples"), *_dropped(samples)]
    chart = paragraph("No chart was measured for this scene: casadi-contact chart does.")
    if front is not None:
        chart = picture(lambda path: save_page(draw_speed_accuracy(front), path), "time per pose against error")
    parts += [heading("Speed and accuracy"), chart]
    body = "\n".join(parts)
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n<title>casadi_contact: '
        f"{escape(scene.name)}</title>\n<style>\n{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    )


def _scene_picture(scene: Scene) -> str:
    """The bodies in contact; or in words why there is no picture."""
    try:
        model = ElasticFoundation(scene)
        pose = contact_pose(model)
    except (ValueError, OSError, ImportError) as error:
        return paragraph(f"no picture: {one_line(error)}")
    return picture(lambda path: draw_contact(model, np.array([pose]), path), f"{scene.name} in contact")


def _reach(surrogate: Surrogate) -> list[str]:
    rows = surrogate.info().reach
    if not rows:
        return [paragraph("The file does not record the sampled poses.")]
    cells = [[name, f"{low:.1f}", f"{high:.1f}", unit] for name, low, high, unit in rows]
    share = surrogate.record.get("valid_share")
    said = [] if share is None else [paragraph(f"{100.0 * share:.1f} % of its held-back poses are called valid.")]
    return [*said, table(["sampled", "from", "to", "unit"], cells)]


def _errors(errors: Mapping[str, Any], loads: Sequence[str], tolerances: Mapping[str, float]) -> str:
    if not errors:
        return paragraph("The file records no errors on held-back samples.")

    def cell(error: Mapping[str, float]) -> str:
        return f"{three_digits(error['rms'])} ({three_digits(error['max'])})"

    rows = [[domain, *(cell(row[load]) if load in row else "-" for load in loads)] for domain, row in errors.items()]
    of_domains = list(errors.values())

    def too_large(i: int, j: int) -> bool:
        load = loads[j - 1]
        return j > 0 and i < len(of_domains) and of_domains[i].get(load, {}).get("rms", 0.0) > tolerances[load]

    rows.append(["tolerance it was trained for", *(f"{tolerances[load]:g}" for load in loads)])
    return table(["RMS (largest)", *(quantity(load).label for load in loads)], rows, too_large)


def _coverage(surrogate: Surrogate) -> str:
    coverage, loads = surrogate.info().coverage, surrogate.load_names
    if not coverage:
        return paragraph("This surrogate has neither validity nor expected error: it was never calibrated.")
    columns = ("valid", *loads)
    rows = [[d, *(f"{100.0 * row[c]:.0f}" if c in row else "-" for c in columns)] for d, row in coverage.items()]
    said = "Share [%] of held-back poses with validity above 0.9, and of errors below the expected error."
    others = "; ".join(other_rows(coverage))
    said += f" Rows that are no domains: {others}." if others else ""
    line = model_line(surrogate.record)
    return paragraph(said) + table(["", *columns], rows) + (paragraph(f"All {line}.") if line else "")


def _training(surrogate: Surrogate) -> str:
    info, record = surrogate.info(), surrogate.record
    samples = ", ".join(f"{domain} {count}" for domain, count in info.samples.items()) or "not recorded"
    rows = []
    for name, network in info.networks.items():
        fit = record.get("training_errors", {}).get(name)
        ended = record.get("stop_reasons", {}).get(name, "-")
        hidden = "-".join(map(str, network.hidden))
        rows.append([name, hidden, "-" if fit is None else three_digits(fit), str(ended)])
    made = record.get("command", "not recorded")
    said = paragraph(f"Samples: {samples}. Made by: {made}. Scene {info.scene.digest[:12]}.")
    return said + table(["network", "neurons", "RMS of the fit [N, N·mm]", "ended by"], rows)


def _dropped(samples: Samples | None) -> list[str]:
    if samples is None:
        return [paragraph("No samples of this scene lie beside the surrogates: what was dropped is not known here.")]
    shares = samples.dropped_shares()
    if not any(shares.values()):
        return [paragraph("None.")]
    rows = [[domain, f"{share:.1%}", samples.dropped_reasons(domain) or "-"] for domain, share in shares.items()]
    return [table(["domain", "share of the plan", "why"], rows)]
