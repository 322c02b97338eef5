"""A measured motion as OpenSim's tools prepare it, from their files: COMAK's settings, coordinates, external loads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

from casadi_contact.core.conventions import Array
from casadi_contact.optimisation.assembly.assembly import Assembly, Loaded
from casadi_contact.scenes.opensim import TIME, Table, read_opensim_table, write_table
from casadi_contact.workflow.opensim_import.importing import states_of
from casadi_contact.workflow.opensim_import.model_file import opensim_root


@dataclass(frozen=True)
class Settings:
    """Of a COMAK settings file: times [s] (-1: the motion's), cut-off [Hz] (-1: no filter), names of coordinates and
    weights of muscles by name, and of the contacts' energy."""

    start_s: float
    stop_s: float
    step_s: float
    cutoff_hz: float
    primary: tuple[str, ...]
    secondary: tuple[str, ...]
    weights: Mapping[str, float]
    energy_weight: float = 0.0

    @classmethod
    def read(cls, path: Path) -> Settings:
        """Raises ValueError for a file without the settings that are needed."""
        root = opensim_root(path)
        texts = {element.tag: (element.text or "").strip() for tool in root for element in tool}  # not of its analyses
        try:
            start, stop, step = (float(texts[key]) for key in ("start_time", "stop_time", "time_step"))
            cutoff, energy = float(texts["lowpass_filter_frequency"]), float(texts.get("contact_energy_weight") or 0.0)
            weights = {
                names_of(each.findtext("actuator"))[0]: float(next(each.iter("value")).text or "")
                for each in root.iter()
                if each.find("actuator") is not None
            }
            primary = names_of(texts["primary_coordinates"])
        except (KeyError, ValueError, StopIteration) as error:
            raise ValueError(f"{path} lacks settings of COMAK, or has others than numbers: {error}") from None
        found = [each.findtext("coordinate") or "" for each in root.iter("COMAKSecondaryCoordinate")]
        return cls(start, stop, step, cutoff, primary, names_of(" ".join(found)), weights, energy)


def names_of(paths: str | None) -> tuple[str, ...]:
    """The last parts of OpenSim's paths, a word each."""
    return tuple(path.split("/")[-1] for path in (paths or "").split())


@dataclass(frozen=True)
class Motion:
    """Times (n,), coordinates with rates and accelerations (n, c) [m, rad], and loads (n, 6, bodies) [N, N·m], told as
    `Assembly.function` says."""

    time_s: Array
    q: Array
    u: Array
    udot: Array
    bodies: tuple[Loaded, ...] = ()
    loads: Array | None = None

    def inputs(self, rows: Any = slice(None)) -> list[Array]:
        """q, u, udot and loads of some frames, as `FrameBalance` takes them: frames side by side."""
        loads = np.zeros((len(self.time_s), 6, 0)) if self.loads is None else self.loads
        return [self.q[rows].T, self.u[rows].T, self.udot[rows].T, np.concatenate(list(loads[rows]), axis=1)]


def read_motion(assembly: Assembly, settings: Settings, coordinates: Path, loads: Path | None) -> Motion:
    """A measured motion as OpenSim's tools prepare it: resampled, padded by its reflection, filtered there and back by
    a Butterworth filter of third order, its derivatives those of cubic splines."""
    table = read_opensim_table(coordinates)
    measured, values = table.columns[TIME], states_of(assembly, table)
    step = settings.step_s if settings.step_s > 0.0 else float(np.diff(measured).mean())
    t = measured[0] + step * np.arange(int((measured[-1] - measured[0]) / step + 1e-6) + 1)
    x = np.column_stack([np.interp(t, measured, curve) for curve in values.T])
    if settings.cutoff_hz > 0.0:
        filtered = signal.butter(3, 2.0 * step * settings.cutoff_hz)
        x = signal.filtfilt(*filtered, x, axis=0, padlen=len(x) // 2)
    stop = settings.stop_s if settings.stop_s >= 0.0 else t[-1]
    kept = t[(t > settings.start_s - 0.5 * step) & (t < stop + 0.5 * step)]
    spline = CubicSpline(t, x)
    bodies, wrenches = read_loads(loads, kept) if loads else ((), None)
    return Motion(kept, spline(kept), spline(kept, 1), spline(kept, 2), bodies, wrenches)


def loads_table(path: Path) -> Table:
    """The forces over time that an OpenSim ExternalLoads file names."""
    return read_opensim_table(path.parent / (opensim_root(path).findtext(".//datafile") or "").strip())


def read_loads(path: Path, time_s: Array) -> tuple[tuple[Loaded, ...], Array]:
    """Bodies and their loads (n, 6, bodies) [N, N·m] of an OpenSim ExternalLoads file, as `Motion` has them; a force
    and its point are both told in the ground, or both in the same body."""
    table, found = loads_table(path), dict[Loaded, Array]()
    for force in opensim_root(path).iter("ExternalForce"):
        told = {key.tag: (key.text or "").strip() for key in force}
        body, of_force, of_point = (
            told.get(key, "ground").split("/")[-1]
            for key in ("applied_to_body", "force_expressed_in_body", "point_expressed_in_body")
        )
        if of_force != of_point:
            raise ValueError(
                f"{path}: {force.get('name')} is told in {of_force}, its point in {of_point}: expected one"
            )
        F, point, T = (
            np.column_stack([np.interp(time_s, table.columns[TIME], table.column(key + axis)) for axis in "xyz"])
            if (key := told.get(f"{what}_identifier"))
            else np.zeros((len(time_s), 3))
            for what in ("force", "point", "torque")
        )
        wrench = np.column_stack([F, T + np.cross(point, F)])
        of = body if of_force == "ground" else (body, of_force)
        found[of] = found.get(of, 0.0) + wrench
    return tuple(found), np.stack(list(found.values()), axis=2)


def write_values(path: Path, assembly: Assembly, time_s: Array, q: Array) -> None:
    """Coordinates (n, c) [m, rad] as a motion for OpenSim, in degrees."""
    turns = [c.kind == "rotation" for c in assembly.coordinate_table.values()]
    values = dict(zip(assembly.coordinates, np.where(turns, np.degrees(q), q).T, strict=True))
    write_table(Table("values", {TIME: time_s, **values}, in_degrees=True), path)
