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

/* Inputs of the second stage: pose and clamped forces, with the forces' slopes. */
INLINE void second_inputs(const double *pose, const double *raw, double *u) {
  memcpy(u, pose, 6 * sizeof(double));
  for (int f = 0; f < FORCES; f++) u[6 + f] = raw[f] < 0.0 ? raw[f] : 0.0;
}

INLINE void clamp_slopes(const double *raw, double (*d_raw)[6], double (*d_force)[6]) {
  for (int f = 0; f < FORCES; f++) for (int j = 0; j < 6; j++) d_force[f][j] = raw[f] < 0.0 ? d_raw[f][j] : 0.0;
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
  double raw[FORCES], d_raw[FORCES][6], d_force[FORCES][6], u[INPUTS], y[OUTPUTS + 1], dy[OUTPUTS + 1][INPUTS];
  first_gradient(pose, raw, d_raw[0]);
  second_inputs(pose, raw, u);
  clamp_slopes(raw, d_raw, d_force);
  if (loads) second_gradient(u, y, dy[0]);
  for (int f = 0; roots && f < FORCES; f++) {
    const Root root = root_of(raw[f], REFERENCE_LOAD, ROUNDING);
    roots[f] = root.value;
    for (int j = 0; j < 6; j++) roots_jacobian[f][j] = root.slope * d_raw[f][j];
  }
  for (int k = 0; loads && k < LOADS; k++) {
    const int m = SOURCE[k] - FORCES;
    loads[k] = m < 0 ? u[6 + SOURCE[k]] : y[m];
    for (int j = 0; j < 6; j++) {
      double sum = m < 0 ? d_force[SOURCE[k]][j] : dy[m][j];
      for (int f = 0; m >= 0 && f < FORCES; f++) sum += dy[m][6 + f] * d_force[f][j];
      loads_jacobian[k][j] = sum;
    }
  }
}

/* U^T H U + sum_f g_f d2f, U = (identity; slopes of the forces), H the second stage's weighted Hessian. */
FUNCTION void kernel_hessian(const double *pose, const double *loads_weight, const double *roots_weight,
                             double *hessian) {
  double raw[FORCES], d_raw[FORCES][6], d_force[FORCES][6], u[INPUTS], y[OUTPUTS + 1], c[FORCES + OUTPUTS + 1] = {0};
  double g[INPUTS] = {0}, h[INPUTS * INPUTS] = {0}, right[INPUTS][6], on_force[FORCES], d_all[6] = {0}, d2[36] = {0};
  memset(hessian, 0, 36 * sizeof(double));
  first_gradient(pose, raw, d_raw[0]);
  second_inputs(pose, raw, u);
  clamp_slopes(raw, d_raw, d_force);
  for (int k = 0; k < LOADS; k++) c[SOURCE[k]] += loads_weight[k];
  second_hessian(u, c + FORCES, y, g, h);
  for (int i = 0; i < INPUTS; i++) for (int j = i + 1; j < INPUTS; j++) h[i * INPUTS + j] = h[j * INPUTS + i];
  for (int i = 0; i < INPUTS; i++) {
    for (int j = 0; j < 6; j++) {
      right[i][j] = h[i * INPUTS + j];
      for (int f = 0; f < FORCES; f++) right[i][j] += h[i * INPUTS + 6 + f] * d_force[f][j];
    }
  }
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 6; j++) {
      hessian[6 * i + j] = right[i][j];
      for (int f = 0; f < FORCES; f++) hessian[6 * i + j] += d_force[f][i] * right[6 + f][j];
    }
  }
  for (int f = 0; f < FORCES; f++) {
    on_force[f] = g[6 + f] + c[f];
    if (!(raw[f] < 0.0)) on_force[f] = 0.0;
    if (roots_weight) {
      const Root root = root_of(raw[f], REFERENCE_LOAD, ROUNDING);
      on_force[f] += roots_weight[f] * root.slope;
      for (int i = 0; i < 36; i++) hessian[i] += roots_weight[f] * root.bend * d_raw[f][i / 6] * d_raw[f][i % 6];
    }
  }
  first_hessian(pose, on_force, raw, d_all, d2);
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) hessian[6 * i + j] += i < j ? d2[6 * j + i] : d2[6 * i + j];
}

FUNCTION void kernel_batch(const double *pose, double (*loads)[LANES], double (*roots)[LANES]) {
  double u[INPUTS * LANES], raw[FORCES * LANES], y[(OUTPUTS + 1) * LANES];
  for (int l = 0; l < LANES; l++) for (int j = 0; j < 6; j++) u[j * LANES + l] = pose[6 * l + j];
  first_batch(u, raw);
  for (int f = 0; f < FORCES; f++) {
    for (int l = 0; l < LANES; l++) {
      const double force = raw[f * LANES + l];
      u[(6 + f) * LANES + l] = force < 0.0 ? force : 0.0;
      if (roots) roots[f][l] = root_of(force, REFERENCE_LOAD, ROUNDING).value;
    }
  }
  if (!loads) return;
  second_batch(u, y);
  for (int k = 0; k < LOADS; k++) {
    memcpy(loads[k], SOURCE[k] < FORCES ? u + (6 + SOURCE[k]) * LANES : y + (SOURCE[k] - FORCES) * LANES, sizeof loads[k]);
  }
}
