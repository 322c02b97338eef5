"""Tables of errors say what the errors are against."""

from dataclasses import replace

import numpy as np
import pytest

from casadi_contact.cli.tables import evaluation_tables, fine_grid_remark
from casadi_contact.samples.models import model_pair, models_identity
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.workflow.benchmark.evaluate import evaluate
from tests.support import own_contact
from tests.support.random_surrogates import random_surrogate
from tests.support.smooth_samples import SPHERE, smooth_samples


@pytest.mark.parametrize(("drawn_from", "said"), [("elements", "EF 60×20"), ("foundation", "cc.foundation")])
def test_errors_are_against_the_model_that_samples_were_drawn_from(drawn_from, said):
    """On the grid that they were drawn on, which a scene's [sampling] may choose by itself."""
    settings = SamplingSettings.from_scene(SPHERE, teacher_grid=(60, 20))
    provenance = {**models_identity(model_pair(drawn_from)), "settings": settings.to_table()}
    samples = replace(smooth_samples(60), provenance=provenance)
    tables = evaluation_tables(evaluate({"patch": random_surrogate(SPHERE, "patch")}, samples, None))
    assert [str(table.title).rsplit("unseen samples against ")[1] for table in tables] == [said, said]


def test_errors_of_a_table_of_samples_are_against_these():
    samples = replace(smooth_samples(60), provenance={"table": "mine.csv"})
    tables = evaluation_tables(evaluate({"patch": random_surrogate(SPHERE, "patch")}, samples, None))
    assert str(tables[0].title).endswith("against the samples")


@pytest.mark.parametrize(("off", "said"), [(0.9, ""), (1.1, "Fy in D1"), (np.nan, "")])
def test_a_fine_grid_that_is_off_by_more_than_a_tolerance_is_told(off, said):
    """Of the load that is the most beyond its own tolerance."""
    grid = "×".join(map(str, SPHERE.grids["fine"]))
    errors = {load: {"rms": 0.5 * tolerance} for load, tolerance in SPHERE.tolerances.items()}
    errors["Fy"] = {"rms": off * SPHERE.tolerances["Fy"]}
    remark = fine_grid_remark({"domain_errors": {f"EF {grid}": {"D1": errors}, "patch": {}}}, SPHERE)
    assert said in remark
    assert bool(remark) == bool(said)


def test_a_scene_without_grids_has_no_fine_one_to_tell_of():
    assert own_contact.SCENE.grids == {}
    assert fine_grid_remark({"domain_errors": {"patch": {}}}, own_contact.SCENE) == ""
