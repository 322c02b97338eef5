"""The measured speed-accuracy front: one row per model in ``speed_accuracy.csv``, which charts and choices read.

The file opens with ``# key: value`` lines (scene, machine, versions, threads); then come a line of column names and a
row per model, readable by ``pandas.read_csv(path, comment="#")``. Names carry units; a cell is empty where a model
has no such number.
"""

import csv
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import Any

from casadi_contact.core.files.reading import MOST_TEXT, checked_size
from casadi_contact.core.files.writing import replacing
from casadi_contact.core.quantities import FORCE, TORQUE, Kind, of_kind, quantity
from casadi_contact.scenes.scene import Scene

FILE_NAME = "speed_accuracy.csv"
FORMAT = "casadi_contact speed-accuracy 2"
TIMES = ("value", "jacobian", "hessian", "batch")
_ENDS = ("_us", "_low_us", "_high_us")  # of the columns of a time
_OTHERS = ("samples", "training_seconds", "parameters", "remark", "failure")


@dataclass(frozen=True)
class Timing:
    """Microseconds per pose: median, lowest and highest of the repeated measurements."""

    median_us: float
    low_us: float
    high_us: float


@dataclass(frozen=True)
class Point:
    """A model on the chart: times [µs] per pose on one thread, None for what it cannot do, RMS error of each load
    [N, N·mm] on unseen walking, and what it cost. A failed model has none of these, and says why."""

    name: str
    family: str
    value: Timing | None = None
    jacobian: Timing | None = None
    hessian: Timing | None = None
    batch: Timing | None = None
    load_rms: Mapping[str, float] = field(default_factory=dict)
    samples: int = 0
    training_seconds: float = 0.0
    parameters: int = 0
    remark: str = ""
    failure: str = ""

    def rms(self, kind: Kind, loads: Sequence[str] | None = None) -> float:
        """RMS over those of the given loads on walking that are of a kind, in its unit; NaN if there is none."""
        names = list(self.load_rms) if loads is None else loads
        chosen = [self.load_rms.get(name, math.nan) for name in of_kind(names, kind)]
        return math.sqrt(sum(rms**2 for rms in chosen) / len(chosen)) if chosen else math.nan

    force_rms_n = property(lambda self: self.rms(FORCE), doc="RMS over all forces on walking [N].")
    torque_rms_nmm = property(lambda self: self.rms(TORQUE), doc="RMS over all torques on walking [N·mm].")


@dataclass(frozen=True)
class Front:
    """All measured points; header: what they were measured on, as text."""

    header: Mapping[str, str]
    points: tuple[Point, ...]

    @property
    def loads(self) -> tuple[str, ...]:
        """The scene's loads in their order."""
        return tuple(self.header["loads"].split())

    @property
    def models(self) -> tuple[Point, ...]:
        """The models that were measured, without failures."""
        return tuple(point for point in self.points if not point.failure)


def _rms_column(load: str) -> str:
    return f"rms_{load}_{quantity(load).kind.plain_unit.lower()}"


def _columns(loads: Sequence[str]) -> list[str]:
    times = [f"{what}{end}" for what in TIMES for end in _ENDS]
    return ["name", "family", *times, "force_rms_n", "torque_rms_nmm", *map(_rms_column, loads), *_OTHERS]


def _row(point: Point, loads: Sequence[str]) -> dict[str, str]:
    row = {"force_rms_n": point.force_rms_n, "torque_rms_nmm": point.torque_rms_nmm}
    for what in TIMES:
        timing: Timing | None = getattr(point, what)
        if timing is not None:
            row |= zip((f"{what}{end}" for end in _ENDS), astuple(timing), strict=True)
    row |= {_rms_column(load): point.load_rms[load] for load in loads if load in point.load_rms}
    cells: dict[str, Any] = {name: f"{value:.6g}" if math.isfinite(value) else "" for name, value in row.items()}
    cells |= {name: getattr(point, name) for name in ("name", "family", *_OTHERS)}
    # No commas, quotes or comment signs in texts: numpy.genfromtxt and a shell can then read the file as well.
    replaced = str.maketrans({",": ";", '"': "'", "#": "", "\n": " ", "\r": " "})
    return {name: str(cell).translate(replaced) for name, cell in cells.items()}


def write_front(path: Path, front: Front) -> None:
    """Write the file beside and rename; raises OSError where it cannot be written."""
    with replacing(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        for key, value in {"format": FORMAT, **front.header}.items():
            file.write(f"# {key}: {' '.join(value.split())}\n")
        writer = csv.DictWriter(file, _columns(front.loads), restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(_row(point, front.loads) for point in front.points)


def read_front(path: str | Path) -> Front:
    """Read the file; raises FileNotFoundError, and ValueError for one that is not as `write_front` writes it."""
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path} does not exist: run casadi-contact chart first")
    checked_size(path, MOST_TEXT)
    try:
        lines = path.read_text("utf-8").splitlines()
        comments = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
        header = {key.strip(): value.strip() for key, _, value in (line[1:].partition(":") for line in comments)}
        if header.pop("format", None) != FORMAT or not header["scene"] or not header["scene_digest"]:
            raise ValueError(f"expected '# format: {FORMAT}', a scene and its digest")
        loads = header["loads"].split()
        rows = csv.reader(lines[len(comments) :])
        if next(rows, None) != (columns := _columns(loads)):
            raise ValueError(f"expected the columns {columns[0]},...,{columns[-1]}")
        points = tuple(_point(dict(zip(columns, cells, strict=True)), loads) for cells in rows)
    except (ValueError, KeyError, csv.Error) as error:
        raise ValueError(f"{path} is not as casadi-contact chart writes it ({error}): measure again") from None
    return Front(header, points)


def shipped_front(scene: Scene) -> tuple[Path, Front] | None:
    """The file of the front shipped for this very scene, and the front; None if there is none."""
    path = Path(__file__).parent / "ready" / f"{Path(scene.name).name}.csv"
    if not path.is_file():
        return None
    front = read_front(path)
    return (path, front) if front.header["scene_digest"] == scene.digest else None


def _point(row: Mapping[str, str], loads: Sequence[str]) -> Point:
    def number(name: str) -> float:
        value = float(row[name])
        if not (math.isfinite(value) and value >= 0.0):
            raise ValueError(f"{name} is {row[name]}, expected a finite number of 0 or more")
        return value

    timed = [what for what in TIMES if row[f"{what}_us"]]
    timings: dict[str, Any] = {what: Timing(*(number(f"{what}{end}") for end in _ENDS)) for what in timed}
    texts = {name: row[name] for name in ("name", "family", "remark", "failure")}
    counts = {name: int(number(name)) for name in ("samples", "parameters")}
    rms = {load: number(_rms_column(load)) for load in loads if row[_rms_column(load)]}
    return Point(**texts, **timings, load_rms=rms, training_seconds=number("training_seconds"), **counts)  # type: ignore[arg-type]
