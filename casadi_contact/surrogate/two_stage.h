/* s = n/(n^2 + e^2)^(1/4) with n = -force/reference: sign(n) sqrt|n|, its infinite slope at zero rounded off. */
typedef struct {
  double value, slope, bend; /* and its derivatives by the force */
} Root;

INLINE Root root_of(double force, double reference, double e2) {
  const double n = -force / reference, q = n * n + e2, fourth = sqrt(sqrt(q));
  const Root root = {n / fourth, -(0.5 * n * n + e2) / (q * fourth) / reference,
                     -(0.25 * n * n + 1.5 * e2) * n / (q * q * fourth) / (reference * reference)};
  return root;
}

/* Inputs of the second stage: pose and clamped forces, */
INLINE void second_inputs(const double *pose, const double *raw, double *u) {
  memcpy(u, pose, 6 * sizeof(double));
  for (int f = 0; f < FORCES; f++) u[6 + f] = raw[f] < 0.0 ? raw[f] : 0.0;
}

/* and their derivatives by the pose */
INLINE void input_slopes(const double *raw, double (*d_raw)[6], double (*by_pose)[6]) {
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) by_pose[i][j] = i == j;
  for (int f = 0; f < FORCES; f++) for (int j = 0; j < 6; j++) by_pose[6 + f][j] = raw[f] < 0.0 ? d_raw[f][j] : 0.0;
}

FUNCTION void kernel_value(const double *pose, double *loads, double *roots) {
  double raw[FORCES], u[INPUTS], y[OUTPUTS + 1];
  first_value(pose, raw);
  second_inputs(pose, raw, u);
  if (loads) second_value(u, y);
  for (int k = 0; loads && k < LOADS; k++) loads[k] = SOURCE[k] < FORCES ? u[6 + SOURCE[k]] : y[SOURCE[k] - FORCES];
  for (int f = 0; roots && f < FORCES; f++) roots[f] = root_of(raw[f], REFERENCE_LOAD, ROUNDING).value;
}

FUNCTION void kernel_jacobian(const double *pose, double *loads, double *roots, double (*loads_jacobian)[6],
                              double (*roots_jacobian)[6]) {
  double raw[FORCES], d_raw[FORCES][6], by_pose[INPUTS][6], u[INPUTS], y[OUTPUTS + 1], dy[OUTPUTS + 1][INPUTS];
  first_gradient(pose, raw, d_raw[0]);
  second_inputs(pose, raw, u);
  input_slopes(raw, d_raw, by_pose);
  if (loads) second_gradient(u, y, dy[0]);
  for (int f = 0; roots && f < FORCES; f++) {
    const Root root = root_of(raw[f], REFERENCE_LOAD, ROUNDING);
    roots[f] = root.value;
    for (int j = 0; j < 6; j++) roots_jacobian[f][j] = root.slope * d_raw[f][j];
  }
  for (int k = 0; loads && k < LOADS; k++) {
    const int m = SOURCE[k] - FORCES;
    loads[k] = m < 0 ? u[6 + SOURCE[k]] : y[m];
    if (m < 0) memcpy(loads_jacobian[k], by_pose[6 + SOURCE[k]], sizeof loads_jacobian[k]);
    else through(INPUTS, dy[m], by_pose, loads_jacobian[k]);
  }
}

/* U^T H U + sum_f g_f d2f, U = (identity; slopes of the forces), H the second stage's weighted Hessian. */
FUNCTION void kernel_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  double raw[FORCES], d_raw[FORCES][6], by_pose[INPUTS][6], u[INPUTS], y[OUTPUTS + 1], c[FORCES + OUTPUTS + 1] = {0};
  double g[INPUTS] = {0}, h[INPUTS * INPUTS] = {0}, on_force[FORCES], d_all[6] = {0}, d2[36] = {0};
  memset(hessian, 0, 36 * sizeof(double));
  first_gradient(pose, raw, d_raw[0]);
  second_inputs(pose, raw, u);
  input_slopes(raw, d_raw, by_pose);
  if (loads_weight) {
    for (int k = 0; k < LOADS; k++) c[SOURCE[k]] += loads_weight[k];
    second_hessian(u, c + FORCES, y, g, h);
    add_through(INPUTS, h, by_pose, hessian);
  }
  for (int f = 0; f < FORCES; f++) {
    on_force[f] = raw[f] < 0.0 ? g[6 + f] + c[f] : 0.0;
    if (roots_weight) {
      const Root root = root_of(raw[f], REFERENCE_LOAD, ROUNDING);
      on_force[f] += roots_weight[f] * root.slope;
      for (int i = 0; i < 36; i++) hessian[i] += roots_weight[f] * root.bend * d_raw[f][i / 6] * d_raw[f][i % 6];
    }
  }
  first_hessian(pose, on_force, raw, d_all, d2);
  add_through(6, d2, by_pose, hessian);
}
