"""Tables of errors say what the errors are against."""

from dataclasses import replace

import pytest

from casadi_contact.cli.tables import evaluation_tables
from casadi_contact.samples.models import model_pair, models_identity
from casadi_contact.samples.settings import SamplingSettings
from casadi_contact.workflow.benchmark.evaluate import evaluate
from tests.support.random_surrogates import random_surrogate
from tests.support.smooth_samples import SPHERE, smooth_samples


@pytest.mark.parametrize(
    ("drawn_from", "said"), [("elements", "EF 60×20"), ("foundation", "cc.foundation"), (None, "the samples")]
)
def test_errors_are_against_the_model_that_samples_were_drawn_from(drawn_from, said):
    """On the grid that they were drawn on, which a scene's [sampling] may choose by itself; or a table of samples."""
    settings = SamplingSettings.from_scene(SPHERE, teacher_grid=(60, 20)).to_table()
    made = {"table": "mine.csv"}
    if drawn_from:
        made = {**models_identity(model_pair(drawn_from)), "settings": settings}
    samples = replace(smooth_samples(60), provenance=made)
    tables = evaluation_tables(evaluate({"patch": random_surrogate(SPHERE, "patch")}, samples, None))
    assert [str(table.title).rsplit("unseen samples against ")[1] for table in tables] == [said, said]
