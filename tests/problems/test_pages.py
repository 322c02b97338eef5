"""Pages of results: a result file that no page can be made of is named, with the cure."""

import json

import pytest

from problems.studies.pages.problems import muscle_contact_page, pose_estimation_page, stability_page
from problems.studies.pages.surrogates import seeds_page
from tests.support.stored_results import RESULTS

POSE, MUSCLE = (sorted((RESULTS / name).glob("*.json"))[-1] for name in ("pose_estimation", "muscle_contact"))
PAGES = {
    RESULTS / "seeds.json": seeds_page,
    RESULTS / "stability.json": stability_page,
    POSE: lambda path: pose_estimation_page([path]),
    MUSCLE: lambda path: muscle_contact_page([path]),
    RESULTS / "muscle_settings.json": lambda path: muscle_contact_page([MUSCLE], path),
}


@pytest.mark.parametrize("stored", PAGES, ids=lambda path: path.name)
def test_a_damaged_result_file_is_named_with_the_cure(stored, tmp_path):
    content = json.loads(stored.read_text("utf-8"))
    damaged = ["{}", "[]", "{"]
    if "machine" in content:
        damaged.append(json.dumps({**content, "machine": {}}))
    for text in damaged:
        path = tmp_path / stored.name
        path.write_text(text, "utf-8")
        with pytest.raises(ValueError, match=r"is damaged \(.+\): run the command that wrote it again") as told:
            PAGES[stored](path)
        assert str(told.value).startswith(str(path))


def test_of_several_result_files_the_damaged_one_is_named(tmp_path):
    content = json.loads(POSE.read_text("utf-8"))
    del content["seconds"]
    path = tmp_path / "later.json"
    path.write_text(json.dumps(content), "utf-8")
    with pytest.raises(ValueError, match=r"later.json is damaged \(KeyError: 'seconds'\)"):
        pose_estimation_page([POSE, path])
