"""Every method of the study lowers the error of the same start within its time."""

import json

import numpy as np
import torch

from casadi_contact.samples.samples import write_samples
from problems.studies import optimisers
from tests.support.smooth_samples import smooth_samples


def test_every_method_learns_within_its_time(tmp_path):
    torch.func.vmap(torch.func.grad(torch.sin))(torch.ones(2))  # loads a second's worth of modules
    samples = smooth_samples(200)
    write_samples(tmp_path / "samples.h5", samples)
    optimisers.main(tmp_path / "samples.h5", seconds=0.5, width=3, out=tmp_path / "out.json")
    content = json.loads((tmp_path / "out.json").read_text())
    normal = -samples.wrenches[:, 0, 1]
    assert len(content["rms_n"]) == 4
    for name, (trained, held_back) in content["rms_n"].items():
        assert trained < np.std(normal), name
        assert held_back < 1.5 * np.std(normal), name
