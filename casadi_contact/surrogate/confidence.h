/* Validity and expected error of a pose: formulas of confidence.py. */
#define PADDED_CENTRES ((CENTRES + WIDTH - 1) / WIDTH * WIDTH)
#define FAR 1e8 /* inputs are clipped here, so that the square of any finite number is finite */

INLINE double clipped(double x) { return x > FAR ? FAR : (x < -FAR ? -FAR : x); }

/* -log sum_j exp(-|z - c_j|^2/2h^2); centres [coordinate][j] */
INLINE double soft_distance(const double *z) {
  double k[PADDED_CENTRES], least[WIDTH], sum[WIDTH] = {0}, total = 0.0;
  for (int j = 0; j < PADDED_CENTRES; j++) {
    double square = 0.0;
    for (int i = 0; i < 6; i++) square += (z[i] - centres[i][j]) * (z[i] - centres[i][j]);
    k[j] = 0.5 / (BANDWIDTH * BANDWIDTH) * square;
  }
  for (int j = CENTRES; j < PADDED_CENTRES; j++) k[j] = 1e300; /* only fills up */
  memcpy(least, k, sizeof least);
  for (int j = WIDTH; j < PADDED_CENTRES; j += WIDTH) {
    KEEP_LOOP for (int l = 0; l < WIDTH; l++) least[l] = k[j + l] < least[l] ? k[j + l] : least[l];
  }
  for (int l = 1; l < WIDTH; l++) least[0] = least[l] < least[0] ? least[l] : least[0];
  for (int j = 0; j < PADDED_CENTRES; j += VECTOR) *(Stored *)(k + j) = decay(loaded(k + j) - least[0]);
  for (int j = 0; j < PADDED_CENTRES; j += WIDTH) KEEP_LOOP for (int l = 0; l < WIDTH; l++) sum[l] += k[j + l];
  for (int l = 0; l < WIDTH; l++) total += sum[l];
  return least[0] - log(total);
}

/* parts: the kernel's root loads at the pose. errors may be 0; NaN for a load that was not calibrated. */
FUNCTION double confidence_at(const double *pose, const double *parts, double *errors) {
  double z[6], roots[PATCHES], x[CONFIDENCE_COLUMNS + PATCHES], y[1 + CALIBRATED], far, u;
  if (!finite_pose(pose)) {
    if (errors) fill_nan(LOADS, errors);
    return NAN;
  }
  for (int i = 0; i < 6; i++) {
    z[i] = 0.0;
    for (int j = 0; j < 6; j++) z[i] += whitening[i][j] * pose[j];
    z[i] = clipped(z[i]);
  }
  confidence_roots(pose, parts, roots);
  for (int i = 0; i < CONFIDENCE_COLUMNS; i++) x[i] = clipped(pose[confidence_columns[i]]);
  for (int p = 0; p < PATCHES; p++) x[CONFIDENCE_COLUMNS + p] = clipped(roots[p]);
  confidence_value(x, y);
  far = SHARPNESS * (soft_distance(z) - EDGE);
  u = (far > y[0] ? far : y[0]) + log1p(exp(-fabs(far - y[0])));
  if (errors) {
    const double v = u > -SURE ? u + SURE : 0.0, outside = v * (v * v / (1.0 + v * v));
    for (int k = 0; k < LOADS; k++) {
      const int of = calibrated_load[k];
      errors[k] = of < 0 ? NAN : exp(y[1 + of]) + outside * growth[of];
    }
  }
  return 0.5 - 0.5 * u / sqrt(1.0 + u * u);
}
