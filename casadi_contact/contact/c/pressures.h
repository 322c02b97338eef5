/* Pressure outputs of a pose, seven for each patch in the order of contact/pressures.py: area [mm2], mean and peak pressure
 * [MPa], centre of pressure [mm] (NaN out of contact), penetration [mm]. A model defines patch_moments: area, integrals of p
 * and p c, largest depth, with derivatives by the twist of the moving body about t. */
#define OUTPUTS (7 * PATCHES)
#define PRESSURE_STEP 1e-4 /* of differences [mm]; of angles 1/25 of it */

INLINE void pressure_outputs(const double *pose, double *outputs, double (*slopes)[6]) {
  const Frame frame = frame_of(pose);
  for (int p = 0; p < PATCHES; p++) {
    double *of = outputs + 7 * p, m[6] = {0.0}, by_twist[6][6] = {{0.0}}, by[6][6];
    patch_moments(p, pose, &frame, m, by_twist);
    of[0] = m[0], of[1] = m[1] > 0.0 ? m[1] / m[0] : 0.0, of[2] = pressure_at(all(m[5]))[0], of[6] = m[5];
    for (int k = 0; k < 3; k++) of[3 + k] = m[1] > 0.0 ? m[2 + k] / m[1] : NAN;
    for (int k = 0; k < 6 && slopes; k++) row_by_pose(&frame, by_twist[k], by[k]);
    for (int j = 0; j < 6 && slopes; j++) {
      double(*rows)[6] = slopes + 7 * p;
      rows[0][j] = by[0][j], rows[6][j] = by[5][j];
      rows[1][j] = m[1] > 0.0 ? (by[1][j] - of[1] * by[0][j]) / m[0] : 0.0;
      rows[2][j] = pressure_slope_at(all(m[5]))[0] * by[5][j];
      for (int k = 0; k < 3; k++) rows[3 + k][j] = (by[2 + k][j] - of[3 + k] * by[1][j]) / m[1];
    }
  }
}

FUNCTION void pressure_kernel_value(const double *pose, double *outputs, double *nothing) {
  (void)nothing, pressure_outputs(pose, outputs, 0);
}

FUNCTION void pressure_kernel_jacobian(const double *pose, double *outputs, double *nothing, double (*slopes)[6],
                                       double (*none)[6]) {
  (void)nothing, (void)none, pressure_outputs(pose, outputs, slopes);
}

/* Differences of the first derivatives */
FUNCTION void pressure_kernel_hessian(const double *pose, const double *weights, const double *nothing, double *hessian) {
  double half[6][6] = {{0.0}};
  (void)nothing;
  for (int side = -1; side < 2; side += 2) {
    for (int j = 0; j < 6; j++) {
      const double step = side * PRESSURE_STEP * (j < 3 ? 1.0 : 0.04);
      double moved[6], outputs[OUTPUTS], slopes[OUTPUTS][6];
      memcpy(moved, pose, sizeof moved);
      moved[j] += step;
      pressure_outputs(moved, outputs, slopes);
      for (int k = 0; k < OUTPUTS; k++) {
        for (int i = 0; i < 6 && weights && weights[k] != 0.0; i++) half[j][i] += 0.25 / step * weights[k] * slopes[k][i];
      }
    }
  }
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) hessian[6 * i + j] = half[i][j] + half[j][i];
}
