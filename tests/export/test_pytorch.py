"""Contact inside PyTorch: values, gradients and double backward are the model's own."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the bridge needs casadi_contact[torch]")

import casadi_contact as cc  # noqa: E402
from casadi_contact.export.pytorch import contact_loads  # noqa: E402
from tests.export.oracle import ON_PLANE, POSES, SURROGATE, graph_derivatives, sphere_elements  # noqa: E402
from tests.support.agreement import close  # noqa: E402


def test_values_first_and_second_derivatives_are_those_of_the_surrogate():
    loads = contact_loads(SURROGATE)
    values, slopes, bends = graph_derivatives(SURROGATE, POSES)
    for pose, value, slope, bend in zip(torch.tensor(POSES[:4]), values, slopes, bends, strict=False):
        close(loads(pose), value, 12)
        close(torch.autograd.functional.jacobian(loads, pose), slope, 12)
        squares = torch.autograd.functional.hessian(lambda p: loads(p).square().sum(), pose)
        close(squares, 2.0 * (slope.T @ slope + np.einsum("l,lij->ij", value, bend)), 12)


def test_any_leading_axes_and_a_foundation_will_do():
    model = cc.foundation("sphere_on_plane", compiled=False)
    poses = torch.tensor([[[0.0, 29.9, 0.0, 0.0, 0.0, 0.1]] * 3] * 2, dtype=torch.float64, requires_grad=True)
    loads = contact_loads(model)(poses)
    assert loads.shape == (2, 3, len(model.load_names))
    close(loads[1, 2].detach(), model(poses[1, 2].detach().numpy()), 12)
    loads[..., 0].sum().backward()
    close(poses.grad[0, 1], model.jacobian(poses[0, 1].detach().numpy())[1][0], 12)


def test_single_precision_what_is_not_finite_arrays_of_others_and_third_derivatives_are_refused():
    loads = contact_loads(SURROGATE)
    with pytest.raises(ValueError, match="float32"):
        loads(torch.tensor(POSES, dtype=torch.float32))
    with pytest.raises(ValueError, match="nan"):
        loads(torch.full((6,), torch.nan, dtype=torch.float64))
    for foreign in (np.zeros(6), [0.0] * 6):
        with pytest.raises(ValueError, match=r"expected a tensor: torch.tensor\(poses\)"):
            loads(foreign)
    pose = torch.tensor(POSES[0], requires_grad=True)
    (first,) = torch.autograd.grad(loads(pose).square().sum(), pose, create_graph=True)
    (second,) = torch.autograd.grad(first.sum(), pose, create_graph=True)
    with pytest.raises(RuntimeError, match="no third derivatives"):
        torch.autograd.grad(second.sum(), pose)


def test_elements_give_a_slope_and_refuse_a_second_derivative():
    elements = sphere_elements()
    pose = torch.tensor(ON_PLANE, requires_grad=True)
    (slope,) = torch.autograd.grad(contact_loads(elements)(pose)[1], pose, create_graph=True)
    close(slope.detach(), elements.jacobian(ON_PLANE)[1][1], 12)
    with pytest.raises(ValueError, match="ElasticFoundation gives no hessian, expected a surrogate or"):
        slope[1].backward()


def test_what_gives_no_loads_of_poses_is_refused():
    with pytest.raises(ValueError, match="gives no"):
        contact_loads(SURROGATE.scene)
