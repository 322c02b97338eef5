/* The kernel's functions as others call them: NaN in all outputs where the pose is not finite. */
FUNCTION void guarded_value(const double *pose, double *loads, double *roots) {
  if (finite_pose(pose)) {
    kernel_value(pose, loads, roots);
    return;
  }
  fill_nan(LOADS, loads);
  if (ROOTS) fill_nan(ROOTS, roots);
}

FUNCTION void guarded_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[6],
                               double (*roots_jacobian)[6]) {
  if (finite_pose(pose)) {
    kernel_jacobian(pose, loads, roots, loads_jacobian, roots_jacobian);
    return;
  }
  fill_nan(LOADS, loads);
  for (int k = 0; k < LOADS; k++) fill_nan(6, loads_jacobian[k]);
  if (ROOTS) {
    fill_nan(ROOTS, roots);
    for (int k = 0; k < ROOTS; k++) fill_nan(6, roots_jacobian[k]);
  }
}

FUNCTION void guarded_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                              double *hessian) {
  if (finite_pose(pose)) kernel_hessian(pose, loads_weight, roots_weight, hessian);
  else fill_nan(36, hessian);
}

FUNCTION void guarded_batch(const double *pose, double (*loads)[LANES], double (*roots)[LANES]) {
  kernel_batch(pose, loads, roots);
  for (int l = 0; l < LANES; l++) {
    if (finite_pose(pose + 6 * l)) continue;
    for (int k = 0; k < LOADS; k++) loads[k][l] = NAN;
    for (int k = 0; k < ROOTS; k++) roots[k][l] = NAN;
  }
}
