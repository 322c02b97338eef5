"""A project: one scene, one preset, and the folder that holds every file made from them."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from hashlib import sha256
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from casadi_contact.contact.elements.foundation import ElasticFoundation
from casadi_contact.core.conventions import Array
from casadi_contact.core.files.writing import folder_lock, writable_folder
from casadi_contact.samples.reference import ReferenceMotion, found_sensitive_pose, reference_motion
from casadi_contact.samples.resume import KeptMotion
from casadi_contact.samples.samples import Samples, partial_folder, read_samples
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.scenes.loading import load_scene, ready_scenes
from casadi_contact.scenes.scene import Scene
from casadi_contact.scenes.walking import has_gait, reference_motion_cycles
from casadi_contact.surrogate.base import Surrogate
from casadi_contact.surrogate.load import STRUCTURES, load_surrogate, ready_surrogates
from casadi_contact.workflow.presets import PRESETS, Preset


@dataclass(frozen=True)
class Project:
    """A scene, a preset and the folder that holds everything made from them; own: a preset that has no name; given: the
    name or path as the user gave it; surrogate: the one that was given instead of a scene."""

    scene: Scene
    preset_name: str
    folder: Path
    own: Preset | None = None
    given: str = ""
    surrogate: Surrogate | None = None

    @classmethod
    def open(cls, scene: str | Path | Scene, preset: str, folder: Path | None = None) -> Project:
        """Check the names and make the folder (results/SCENE-PRESET if left out). scene: a ready name or .toml, or a
        surrogate by its name or .h5 file, which stands for its scene and for what was trained on it. The sensitive pose
        parameters of a scene that leaves them out are found."""
        # "knee" is both a scene and a surrogate: the scene
        given = scene.name if isinstance(scene, Scene) else str(scene)
        named = given.endswith(".h5") or (given in ready_surrogates() and given not in ready_scenes())
        surrogate = load_surrogate(given) if named else None
        loaded = scene if isinstance(scene, Scene) else surrogate.scene if surrogate else load_scene(scene)
        if preset not in PRESETS:
            raise ValueError(f"unknown preset {preset!r}, expected one of {', '.join(PRESETS)}")
        folder = _folder_of(loaded, preset) if folder is None else Path(folder)
        writable_folder(folder)
        if not loaded.sensitive_pose and (loaded.motion or has_gait(loaded)):  # of known poses none is needed
            model = ElasticFoundation(loaded, loaded.grids.get("settle"))
            cycles = reference_motion_cycles(loaded, ())
            loaded = loaded.with_sensitive_pose(found_sensitive_pose(model, cycles))
        return cls(loaded, preset, folder, given=given, surrogate=surrogate)

    def command(self, name: str, *options: str, preset: bool = True) -> str:
        """The command line NAME for this scene, preset and folder, as messages and records give it to run."""
        words = ["casadi-contact", name, self.given or self.scene.name]
        words += ["--preset", self.preset_name] if preset else []
        out = [] if self.folder == _folder_of(self.scene, self.preset_name) else ["--out", str(self.folder)]
        return shlex.join([*words, *options, *out])

    @property
    def preset(self) -> Preset:
        """How much is sampled and trained."""
        return PRESETS[self.preset_name] if self.own is None else self.own

    @property
    def samples_path(self) -> Path:
        """Where the drawn samples lie."""
        return self.folder / "samples.h5"

    @property
    def motion_path(self) -> Path:
        """Where the reference motion lies that samples were drawn around."""
        return self.folder / "motion.npz"

    def surrogate_path(self, structure: str) -> Path:
        """Where the trained surrogate of a structure lies."""
        return self.folder / f"{structure}.h5"

    def training_folder(self, *names: str) -> Path:
        """Where the checkpoints of a training lie: a folder for the tolerances of now, since fits to others differ."""
        tolerances = sha256(json.dumps(self.scene.tolerances, sort_keys=True).encode()).hexdigest()[:8]
        return self.folder.joinpath(*names[:-1], "training", f"{names[-1]}-{tolerances}")

    @property
    def has_results(self) -> bool:
        """True where the folder holds samples or a surrogate; shipped surrogates are then not used."""
        return any(path.is_file() for path in (self.samples_path, *map(self.surrogate_path, STRUCTURES)))

    def samples(self) -> Samples:
        """The drawn samples, of a scene that may have had other tolerances."""
        if not self.samples_path.is_file() and not partial_folder(self.samples_path).is_dir():
            raise FileNotFoundError(f"{self.samples_path} does not exist: run {self.command('sample')} first")
        samples = read_samples(self.samples_path)
        self.check_scene(samples.scene, f"{self.samples_path} holds samples of")
        return samples

    def check_scene(self, scene: Scene, made_for: str) -> None:
        """ValueError where what lies in the folder is of another scene, tolerances apart; made_for: what it is."""
        if scene.digest != self.scene.digest:
            raise ValueError(f"{made_for} another scene than {self.scene.name} now: choose another --out, or remove it")


Given = ParamSpec("Given")
Result = TypeVar("Result")


def exclusive(stage: Callable[Concatenate[Project, Given], Result]) -> Callable[Concatenate[Project, Given], Result]:
    """A stage that locks its project's folder while it runs: a second one there fails at once."""

    @wraps(stage)
    def run(project: Project, /, *given: Given.args, **named: Given.kwargs) -> Result:
        with folder_lock(project.folder):
            return stage(project, *given, **named)

    return run


def _folder_of(scene: Scene, preset: str) -> Path:
    """The folder of a project that names none."""
    return Path("results") / f"{scene.name}-{preset}"


def read_motion(project: Project) -> KeptMotion:
    """The reference motion that the samples were drawn around."""
    if project.samples_path.is_file() and not has_motion(project):
        raise ValueError(f"{project.samples_path} was made from a table, which has no motion: sample in another --out")
    if not project.motion_path.is_file():
        raise FileNotFoundError(f"{project.motion_path} does not exist: run {project.command('sample')} first")
    return KeptMotion.read(project.motion_path, project.scene.pose_space)


def has_motion(project: Project) -> bool:
    """False where the samples come from a table."""
    return project.motion_path.is_file() or "table" not in project.samples().provenance


def project_surrogates(project: Project) -> dict[str, Surrogate]:
    """The surrogates in the project's folder by structure; raises FileNotFoundError if there is none."""
    made = trained_surrogates(project)
    if not made:
        command = project.command("train" if project.samples_path.is_file() else "build")
        raise FileNotFoundError(f"no surrogate in {project.folder}: run {command} first")
    return made


def trained_surrogates(project: Project) -> dict[str, Surrogate]:
    """The surrogates in the project's folder by structure, perhaps none; ValueError for one of another scene, which may
    have had other tolerances."""
    if project.surrogate is not None:
        return {project.surrogate.structure: project.surrogate}
    paths = {s: project.surrogate_path(s) for s in STRUCTURES if project.surrogate_path(s).is_file()}
    made = {structure: load_surrogate(path) for structure, path in paths.items()}
    for structure, surrogate in made.items():
        project.check_scene(surrogate.scene, f"{paths[structure]} was trained for")
    return made


def trained_in(folder: str | Path) -> Callable[[Scene], Surrogate | None]:
    """The surrogates that `casadi-contact build` made of an assembly's contacts, for ``load_assembly(name,
    contact=trained_in(folder))``; FileNotFoundError for none."""
    known = {path.parent.name: load_surrogate(path) for path in Path(folder).glob("*/patch.h5")}
    if not known:
        raise FileNotFoundError(f"no surrogates of contacts in {folder}: run casadi-contact build on the assembly")
    return lambda scene: known.get(scene.name)


def shipped_surrogates(scene: Scene) -> dict[str, Surrogate]:
    """The surrogates of this very scene that come with the library, by name."""
    ready = ((name, load_surrogate(name)) for name in ready_surrogates())
    return {name: surrogate for name, surrogate in ready if surrogate.scene.digest == scene.digest}


def available_surrogates(project: Project) -> dict[str, Surrogate]:
    """The given surrogate, or the project's by structure, or its scene's shipped ones where nothing was built."""
    shipped = () if project.has_results or project.surrogate is not None else shipped_surrogates(project.scene).values()
    return {surrogate.structure: surrogate for surrogate in shipped} or project_surrogates(project)


def available_poses(project: Project) -> Array:
    """Poses (n, 6) of the reference motion that the samples were drawn around, one cycle after the other; of a table
    its own. Where nothing has been built, of the built-in cycles, estimated anew (seconds)."""
    if not project.has_results:
        return built_in_motion(project.scene).poses.reshape(-1, 6)
    return read_motion(project).motion.poses.reshape(-1, 6) if has_motion(project) else project.samples().poses


def built_in_motion(scene: Scene) -> ReferenceMotion:
    """The reference motion of the scene's built-in cycles; raises ValueError for a scene without geometry."""
    _ = scene.material  # refuses in words a scene that has no grids either
    model = ElasticFoundation(scene, scene.grids["settle"])
    return reference_motion(model, reference_motion_cycles(scene, ()), SamplingSettings.from_scene(scene))[0]
