"""Tables for the terminal, of errors by domain, of speed and accuracy, and of the choice of a model."""

from collections.abc import Mapping

from rich.table import Table

from casadi_contact.core.quantities import FORCE, TORQUE, of_kind, quantity, three_digits
from casadi_contact.samples.models import model_name_of
from casadi_contact.samples.samples import LoadErrors, Samples
from casadi_contact.workflow.benchmark.choose import Choice
from casadi_contact.workflow.benchmark.front_file import TIMES, Front


def choice_table(choice: Choice) -> Table:
    """The chosen model and the next better one: time per pose, RMS errors on unseen poses of the scene's motion."""
    table = Table(title=f"Cheapest model for {', '.join(choice.loads)} within tolerance, errors on unseen poses")
    errors = [("force_rms_n", FORCE), ("torque_rms_nmm", TORQUE)]
    shown = [(error, kind) for error, kind in errors if of_kind(choice.loads, kind)]
    for column in ("", "model", "time [µs]", *(f"RMS {kind.name} [{kind.unit}]" for _, kind in shown)):
        table.add_column(column, justify="right" if "[" in column else "left")
    for what, offer in (("chosen", choice.model), ("next better", choice.better)):
        if offer is None:
            table.add_row(what, "none measured is more accurate")
            continue
        cells = (f"{getattr(offer, error):.3g}" for error, _ in shown)
        table.add_row(what, offer.name, f"{offer.time_us:.3g}", *cells)
    return table


def evaluation_tables(errors: Mapping[str, Mapping[str, LoadErrors]], samples: Samples) -> list[Table]:
    """The paper's Tables 2 and 3: what `benchmark.measure.evaluate` gives for these samples."""
    loads, counts, tables = samples.scene.load_names, samples.counts(), []
    for key, title in (
        ("rms", "RMS error per domain [EF15 Table 2]"),
        ("max", "Largest error per domain [EF15 Table 3]"),
    ):
        table = Table(title=f"{title}, unseen samples of {model_name_of(samples) or 'another model'}")
        for column in ("model", "domain", "samples"):
            table.add_column(column)
        for load in loads:
            table.add_column(f"{load} ({quantity(load).unit})", justify="right")
        for model, domains in errors.items():
            for domain, found in domains.items():
                cells = [three_digits(found[load][key]) if load in found else "-" for load in loads]
                table.add_row(model, domain, str(counts[domain]["test"]), *cells)
            table.add_section()
        tables.append(table)
    return tables


def front_table(front: Front) -> Table:
    """Times and errors of a measured front [EF15 Table 4]."""
    header = front.header
    title = f"Speed and accuracy on {header['walking_poses']} unseen poses of its motion [EF15 Table 4]"
    table = Table(title=f"{title}, against {header['reference']}; medians per pose")
    kinds = [kind for kind in (FORCE, TORQUE) if of_kind(front.loads, kind)]
    table.add_column("model")
    for column in (*(f"{what} [µs]" for what in ("loads", *TIMES[1:])), *(f"{k.name} [{k.unit}]" for k in kinds)):
        table.add_column(column, justify="right")
    for point in front.models:
        times = (getattr(point, what) for what in TIMES)
        cells = ("" if t is None else f"{t.median_us:.3g}" for t in times)
        table.add_row(point.name, *cells, *(f"{point.rms(kind):.3g}" for kind in kinds))
    return table
