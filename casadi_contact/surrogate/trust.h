/* Validity and expected error of a pose: formulas of trust.py, distrust.py, error_classifier.py, states.py. */
#define PADDED(count) (((count) + WIDTH - 1) / WIDTH * WIDTH)
#define FAR 1e8 /* scaled pose parameters are cut off here, so that the square of any finite pose is finite */

/* log(e^a + e^b) */
INLINE double either(double a, double b) { return (a > b ? a : b) + log1p(exp(-fabs(a - b))); }

INLINE double cut_off(double x) { return x > FAR ? FAR : (x < -FAR ? -FAR : x); }

/* Least of n numbers, and their sum: n is a multiple of WIDTH. */
INLINE double least_of(int n, const double *values) {
  double least[WIDTH];
  memcpy(least, values, sizeof least);
  for (int i = WIDTH; i < n; i += WIDTH) {
    KEEP_LOOP for (int l = 0; l < WIDTH; l++) least[l] = values[i + l] < least[l] ? values[i + l] : least[l];
  }
  for (int l = 1; l < WIDTH; l++) least[0] = least[l] < least[0] ? least[l] : least[0];
  return least[0];
}

INLINE double sum_over(int n, const double *values) {
  double sum[WIDTH];
  memcpy(sum, values, sizeof sum);
  for (int i = WIDTH; i < n; i += WIDTH) {
    KEEP_LOOP for (int l = 0; l < WIDTH; l++) sum[l] += values[i + l];
  }
  return ((sum[0] + sum[4]) + (sum[1] + sum[5])) + ((sum[2] + sum[6]) + (sum[3] + sum[7]));
}

/* -log sum_j exp(-|z - c_j|^2/2h^2) of a point z (size) over count centres [coordinate][j], and weights proportional to
 * the exponentials, that is `total` times theirs; what fills the centres up has no weight. */
INLINE double soft_distance(int size, int count, const double *centres, double bandwidth, const double *z,
                            double *weights, double *total) {
  const int padded = PADDED(count);
  const double half = 0.5 / (bandwidth * bandwidth);
  double least;
  for (int j = 0; j < padded; j++) {
    double square = 0.0;
    for (int k = 0; k < size; k++) {
      const double off = z[k] - centres[k * padded + j];
      square += off * off;
    }
    weights[j] = half * square;
  }
  for (int j = count; j < padded; j++) weights[j] = 1e300;
  least = least_of(padded, weights);
  for (int j = 0; j < padded; j += VECTOR) *(Stored *)(weights + j) = decay(loaded(weights + j) - least);
  *total = sum_over(padded, weights);
  return least - log(*total);
}

/* Products of at most three of n variables, weighted, in the order of structures/cubic_logistic.py. */
INLINE double cubic(int n, const double *weights, const double *x) {
  double sum = *weights++;
  for (int i = 0; i < n; i++) sum += *weights++ * x[i];
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) sum += *weights++ * (x[i] * x[j]);
  }
  for (int i = 0; i < n; i++) {
    for (int j = i; j < n; j++) {
      for (int k = j; k < n; k++) sum += *weights++ * (x[i] * x[j] * x[k]);
    }
  }
  return sum;
}

/* log of the sum of exp(u_i) over the causes of distrust */
INLINE double excess_of(const double *pose, const double *roots, const double *claims, double tube) {
  double causes[1 + 2 * PATCHES + 2 * BOX + 3 + PATCHES], largest, sum = 0.0;
  int n = 0;
  causes[n++] = tube;
  for (int p = 0; p < PATCHES; p++) {
    causes[n++] = (roots[p] - root_high[p]) / margin_high[p] - 2.0;
    causes[n++] = (root_low[p] - roots[p]) / margin_low[p] - 2.0;
  }
#if BOX
  for (int i = 0; i < BOX; i++) {
    const double x = cut_off(pose[box_columns[i]]);
    causes[n++] = (x - box_high[i]) / box_margin[i] - 2.0;
    causes[n++] = (box_low[i] - x) / box_margin[i] - 2.0;
  }
#endif
#if BOUND
  {
    double squares = 0.0;
    for (int i = 0; i < BOUND; i++) {
      double off = cut_off(pose[bound_columns[i]]) - bound_offset[i];
      for (int k = 0; k < 6; k++) off -= bound_rows[i][k] * cut_off(pose[k]);
      squares += off / OFF_SPACE * (off / OFF_SPACE);
    }
    causes[n++] = STEEPNESS * (squares - 1.0);
  }
#endif
#if BORDER
  {
    double x[BORDER];
    for (int i = 0; i < BORDER; i++) {
      const double raw = i < BORDER - PATCHES ? cut_off(pose[border_columns[i]]) : roots[i - (BORDER - PATCHES)];
      x[i] = (raw - border_centre[i]) / border_scale[i];
    }
    causes[n++] = -cubic(BORDER, border_coefficients, x);
  }
#endif
#if CLASSIFIER
  {
    double x[CLASSIFIER], answer;
    for (int i = 0; i < CLASSIFIER - PATCHES; i++) x[i] = cut_off(pose[classifier_columns[i]]);
    for (int p = 0; p < PATCHES; p++) x[CLASSIFIER - PATCHES + p] = cut_off(roots[p]);
    classifier_value(x, &answer);
    causes[n++] = CLASSIFIER_STEEPNESS * (answer - CLASSIFIER_HALF);
  }
#endif
#if CONFIRMATION
  for (int p = 0; p < PATCHES; p++) {
    const double claimed = 4.0 * (claims[p] / confirmation_tolerance[p] - 1.0);
    causes[n++] = -either(-claimed, -(confirmation_root[p] - roots[p]) / confirmation_width[p]);
  }
#endif
  (void)pose, (void)claims;
  largest = causes[0];
  for (int i = 1; i < n; i++) largest = causes[i] > largest ? causes[i] : largest;
  for (int i = 0; i < n; i++) sum += exp(causes[i] - largest);
  return largest + log(sum);
}

#if STATES
#define LEVELS STATES
/* Weights of the error levels, and their sum. */
INLINE void level_weights(const double *pose, const double *roots, double *weights, double *total) {
  double y[STATE_SIZE];
  for (int i = 0; i < STATE_SIZE - PATCHES; i++) y[i] = cut_off(pose[states_columns[i]] / states_scale[i]);
  for (int p = 0; p < PATCHES; p++) {
    const double scale = states_root_scale[p], v = cut_off(roots[p]) + 2.0 * scale;
    y[STATE_SIZE - PATCHES + p] = 0.5 * (v + sqrt(v * v + scale * scale)) / scale;
  }
  (void)soft_distance(STATE_SIZE, STATES, states_centres[0], STATES_BANDWIDTH, y, weights, total);
}
#else
#define LEVELS CENTRES
#endif

/* parts: the kernel's root loads of the pose. errors may be 0; NaN for a load that was not calibrated. */
FUNCTION double trust_at(const double *pose, const double *parts, double *errors) {
  double z[6], weights[PADDED(CENTRES)], roots[PATCHES], claims[PATCHES] = {0}, total, excess, validity;
  if (!finite_pose(pose)) {
    if (errors) fill_nan(LOADS, errors);
    return NAN;
  }
  trust_inputs(pose, parts, roots, claims);
  for (int k = 0; k < 6; k++) z[k] = cut_off(pose[k] / trust_scales[k]);
  excess = SHARPNESS * (soft_distance(6, CENTRES, centres[0], BANDWIDTH, z, weights, &total) - EDGE);
  excess = excess_of(pose, roots, claims, excess);
  validity = 0.5 - 0.5 * excess / sqrt(1.0 + excess * excess);
  if (errors) {
    double features[4 + PATCHES], dense[PADDED(DENSE)], dense_total, rare, pressed_square = 0.0;
    const double out = excess > GROWTH_START ? excess - GROWTH_START : 0.0;
    const double growth = out * (out * out / (1.0 + out * out));
    rare = soft_distance(6, DENSE, dense_centres[0], DENSE_BANDWIDTH, z, dense, &dense_total);
    rare = either(0.0, rare - DENSE_START);
    features[0] = 1.0, features[1] = rare, features[2] = rare * rare;
    for (int p = 0; p < PATCHES; p++) {
      features[3 + p] = 0.5 * (roots[p] + sqrt(roots[p] * roots[p] + BOUNDARY_ROOT * BOUNDARY_ROOT));
      pressed_square += features[3 + p] * features[3 + p];
    }
    features[3 + PATCHES] = LIGHT_SQUARE / (LIGHT_SQUARE + pressed_square);
#if STATES
    double near[PADDED(LEVELS)];
    level_weights(pose, roots, near, &total);
#else
    const double *near = weights;
#endif
    for (int k = 0; k < LOADS; k++) {
      double share = 0.0;
      for (int i = 0; i < 4 + PATCHES; i++) share += features[i] * trust_shares[k][i];
      errors[k] = dot(PADDED(LEVELS), trust_levels[k], near) / total * share + growth * growth_loads[k];
    }
  }
  return validity;
}
