"""Contact inside JAX: values, Jacobians and Hessians are the model's own, under jit and vmap too."""

import pytest

jax = pytest.importorskip("jax", reason="the bridge needs casadi_contact[jax]")

from casadi_contact.export.jax import contact_loads  # noqa: E402
from tests.export.oracle import ON_PLANE, POSES, SURROGATE, graph_derivatives, sphere_elements  # noqa: E402
from tests.support.agreement import close  # noqa: E402


@pytest.fixture(autouse=True)
def _double_precision():
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", False)


@pytest.mark.parametrize("transformed", [lambda f: f, jax.jit], ids=["plain", "jit"])
def test_values_first_and_second_derivatives_are_those_of_the_surrogate(transformed):
    loads = contact_loads(SURROGATE)
    values, slopes, bends = graph_derivatives(SURROGATE, POSES)
    close(transformed(loads)(POSES), values, 12)
    close(transformed(jax.vmap(loads))(POSES), values, 12)
    for order in (jax.jacfwd, jax.jacrev):
        close(transformed(jax.vmap(order(loads)))(POSES), slopes, 12)
    close(transformed(jax.vmap(jax.hessian(loads)))(POSES), bends, 12)
    close(transformed(jax.vmap(jax.jacrev(jax.jacrev(loads))))(POSES), bends, 12)


def test_single_precision_and_other_shapes_are_refused():
    loads = contact_loads(SURROGATE)
    with pytest.raises(ValueError, match=r"poses has shape \(12, 5\), expected \(..., 6\)"):
        loads(POSES[:, :5])
    with pytest.raises(ValueError, match=r"poses is float32, expected float64: jax\.config\.update"):
        loads(POSES.astype("float32"))


def test_a_pose_that_is_not_finite_has_no_loads_and_leaves_the_others_alone():
    loads = contact_loads(SURROGATE)
    poses = jax.numpy.asarray(POSES[:2]).at[0, 1].set(jax.numpy.nan)
    for function in (loads, jax.vmap(jax.jacrev(loads))):
        got = function(poses)
        assert jax.numpy.isnan(got[0]).all()
        close(got[1], function(jax.numpy.asarray(POSES[:2]))[1], 12)


def test_elements_give_a_slope_and_refuse_a_second_derivative_in_one_line():
    elements = sphere_elements()
    loads = contact_loads(elements)
    close(jax.jit(jax.jacfwd(loads))(ON_PLANE), elements.jacobian(ON_PLANE)[1], 12)
    with pytest.raises(ValueError, match="ElasticFoundation gives no hessian, expected a surrogate or") as refused:
        jax.jit(jax.hessian(lambda pose: loads(pose)[1]))(ON_PLANE)
    assert "\n" not in str(refused.value)
