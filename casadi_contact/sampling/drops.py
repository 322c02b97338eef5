"""How much of a sampling plan became no samples, and when that is too much to learn from."""

from __future__ import annotations

from casadi_contact.dataset import DOMAINS, Samples
from casadi_contact.scenes import Scene
from casadi_contact.shapes.mesh_bodies import body_mesh

MOST_DROPPED = 0.3


def dropped_shares(samples: Samples) -> dict[str, float]:
    """Share of the plan that was dropped, by domain that has samples or dropped poses; empty for samples of a table."""
    shares = {}
    for number, domain in enumerate(DOMAINS, start=1):
        kept, lost = int((samples.domain == number).sum()), int((samples.dropped.domain == number).sum())
        if kept + lost and len(samples.dropped):
            shares[domain] = lost / (kept + lost)
    return shares


def refuse_many_dropped(samples: Samples, most: float = MOST_DROPPED) -> None:
    """Raises ValueError for a domain of which more than the share `most` was dropped, with the reasons and the cure."""
    for domain, share in dropped_shares(samples).items():
        if share > most:
            reasons = samples.provenance.get("dropped", {}).get(domain, {})
            listed = "; ".join(f"{reason} ({count})" for reason, count in sorted(reasons.items(), key=lambda r: -r[1]))
            digits = 0 if f"{share:.0%}" != f"{most:.0%}" else 2
            raise ValueError(
                f"{share:.{digits}%} of the samples of {domain} were dropped, expected at most {most:.{digits}%}: "
                f"{listed}. {_cure(max(reasons, key=reasons.get, default=''), samples.scene, domain)}"
                + " To learn from what is left all the same, set most_dropped in the scene's [sampling] and run again: "
                "the samples are kept"
            )


def _cure(reason: str, scene: Scene, domain: str) -> str:
    if "edge" in reason:
        rim = 'set open_edges = "rim" in [geometry] where it ends with its mesh, '
        open_mesh = scene.geometry.get("open_edges") == "cut" and len(body_mesh(scene.geometry, "fixed").boundary_edges)
        return (
            "Contact runs off the fixed surface: enlarge its patches where the part really goes on, "
            + (rim if open_mesh else "")
            + "or draw closer to the reference motion (smaller d3_fraction, d2_offset or d3_minimum_widths in the "
            "scene's [sampling])."
        )
    if "finite" in reason:
        return "Mend the contact model where its loads are not finite, or draw where they are."
    shown = "" if scene.layer is None else " with casadi-contact show"  # which needs surfaces
    if "settle" in reason:
        return (
            "Few of the wanted loads have an equilibrium: check the directions of the loads and of loads.sensitive"
            f"{shown}, or draw closer to the reference motion (smaller d3_fraction or d2_offset)."
        )
    if "touches" in reason:
        return (
            "A step of lifting is shorter than the overlap at the boundary load: lift farther (larger liftoff_mm in "
            "the scene's [sampling]) or lower loads.boundary_load. Or a part embraces the other, which meets its "
            f"opposite wall: lift less far (smaller liftoff_mm). A model that presses however far it is lifted has no "
            f"such samples: set {domain} = 0 in sampling.counts. Else check the scene's patches{shown}."
        )
    return f"Check the scene's surfaces and patches{shown}."
