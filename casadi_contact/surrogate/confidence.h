/* Validity and expected errors: formulas of confidence.py, of q = (pose, root loads). z and the centres, [coordinate][j], are
 * in bandwidths. ROOTS_OF(value) and so on name the functions that give root loads. */
#define FAR 1e8 /* poses are clipped here, so that the square of any finite number is finite */
#define INNER (6 + ROOTS)

typedef struct {
  double share[PADDED_CENTRES], z[6], mean[6]; /* share: exp(-|z - c_j|^2/2) over their sum; mean: of centres, by it */
  double y[1 + LOADS], u, by_far;              /* by_far = du/du_1 = 1 - du/dy_0 */
  double grown[3], valid[3];                   /* g(u + 4/3) and validity, with their derivatives by u */
} Confidence;

/* E = -log sum_j exp(-|z - c_j|^2/2) */
INLINE double soft_distance(const double *z, double *share, int normed) {
  double least = INFINITY, lanes[WIDTH], total = 0.0, half = 0.0;
  Vector nearest = loaded(half_squares) + INFINITY, sum = {0};
  for (int i = 0; i < 6; i++) half += 0.5 * z[i] * z[i];
  for (int j = 0; j < PADDED_CENTRES; j += VECTOR) {
    Vector far = loaded(half_squares + j);
    UNROLL for (int i = 0; i < 6; i++) far -= z[i] * loaded(centres[i] + j);
    *(Stored *)(share + j) = far;
    nearest = smaller_vector(far, nearest);
  }
  memcpy(lanes, &nearest, sizeof nearest);
  for (int l = 0; l < VECTOR; l++) least = lanes[l] < least ? lanes[l] : least;
  for (int j = 0; j < PADDED_CENTRES; j += VECTOR) {
    const Vector part = decay(loaded(share + j) - least);
    *(Stored *)(share + j) = part, sum += part;
  }
  memcpy(lanes, &sum, sizeof sum);
  for (int l = 0; l < VECTOR; l++) total += lanes[l];
  for (int j = 0; normed && j < PADDED_CENTRES; j++) share[j] *= 1.0 / total;
  return half + least - log(total);
}

/* dy_k/dq (slopes, row after row) and what else derivatives need are left out where slopes is 0. */
INLINE void confidence_at(const double *q, Confidence *of, double *slopes) {
  double far, v, s;
  for (int i = 0; i < 6; i++) {
    of->z[i] = 0.0;
    for (int j = 0; j < 6; j++) of->z[i] += whitening[i][j] * q[j];
  }
  if (slopes) confidence_gradient(q, of->y, slopes);
  else confidence_value(q, of->y);
  far = SHARPNESS * (soft_distance(of->z, of->share, slopes != 0) - EDGE);
  s = exp(-fabs(far - of->y[0]));
  of->u = (far > of->y[0] ? far : of->y[0]) + log1p(s), of->by_far = (far > of->y[0] ? 1.0 : s) / (1.0 + s);
  v = of->u > -SURE ? of->u + SURE : 0.0, s = 1.0 + v * v;
  of->grown[0] = v * (v * v / s);
  of->grown[1] = v * v * (3.0 + v * v) / (s * s), of->grown[2] = 2.0 * v * (3.0 - v * v) / (s * s * s);
  s = 1.0 + of->u * of->u;
  of->valid[0] = 0.5 - 0.5 * of->u / sqrt(s);
  of->valid[1] = -0.5 / (s * sqrt(s)), of->valid[2] = 1.5 * of->u / (s * s * sqrt(s));
  for (int i = 0; slopes && i < 6; i++) of->mean[i] = dot(PADDED_CENTRES, of->share, centres[i]);
}

INLINE void inner_at(const double *pose, double *q) {
  for (int j = 0; j < 6; j++) q[j] = pose[j] > FAR ? FAR : (pose[j] < -FAR ? -FAR : pose[j]);
}

FUNCTION void confidence_kernel_value(const double *pose, double *errors, double *validity) {
  double q[INNER];
  Confidence of;
  inner_at(pose, q);
  ROOTS_OF(value)(pose, 0, q + 6);
  confidence_at(q, &of, 0);
  for (int k = 0; errors && k < LOADS; k++) errors[k] = exp(of.y[1 + k]) + growth[k] * of.grown[0];
  if (validity) *validity = of.valid[0];
}

/* dq/dpose; of the network the slopes by q; of y_0, u_1 and u those by the pose */
typedef struct {
  double by_pose[INNER][6], dy[1 + LOADS][INNER], d_class[6], d_far[6], du[6];
} Slopes;

INLINE void confidence_slopes(const double *pose, double *q, Confidence *of, Slopes *slopes) {
  double miss[6];
  for (int i = 0; i < 6; i++) for (int j = 0; j < 6; j++) slopes->by_pose[i][j] = i == j;
  inner_at(pose, q);
  ROOTS_OF(jacobian)(pose, 0, q + 6, 0, slopes->by_pose + 6);
  confidence_at(q, of, slopes->dy[0]);
  through(INNER, slopes->dy[0], slopes->by_pose, slopes->d_class);
  for (int i = 0; i < 6; i++) miss[i] = SHARPNESS * (of->z[i] - of->mean[i]);
  through(6, miss, (double(*)[6])whitening, slopes->d_far);
  for (int j = 0; j < 6; j++) slopes->du[j] = of->by_far * slopes->d_far[j] + (1.0 - of->by_far) * slopes->d_class[j];
}

FUNCTION void confidence_kernel_jacobian(const double *pose, double *errors, double *validity,
                                         double (*errors_jacobian)[6], double (*validity_jacobian)[6]) {
  double q[INNER];
  Confidence of;
  Slopes slopes;
  confidence_slopes(pose, q, &of, &slopes);
  for (int k = 0; errors && k < LOADS; k++) {
    const double usual = exp(of.y[1 + k]), slope = growth[k] * of.grown[1];
    errors[k] = usual + growth[k] * of.grown[0];
    through(INNER, slopes.dy[1 + k], slopes.by_pose, errors_jacobian[k]);
    for (int j = 0; j < 6; j++) errors_jacobian[k][j] = usual * errors_jacobian[k][j] + slope * slopes.du[j];
  }
  if (validity) *validity = of.valid[0];
  for (int j = 0; validity && j < 6; j++) validity_jacobian[0][j] = of.valid[1] * slopes.du[j];
}

FUNCTION void confidence_kernel_hessian(const double *pose, const double *errors_weight, const double *validity_weight,
                                        double *hessian) {
  double q[INNER], c[1 + LOADS] = {0}, by_q[INNER] = {0}, by_q2[INNER * INNER] = {0};
  double sums[21][WIDTH] = {{0}}, spread[36] = {0};
  double on_u = validity_weight ? *validity_weight : 0.0, bend = on_u, on_far;
  Confidence of;
  Slopes by;
  confidence_slopes(pose, q, &of, &by);
  on_u *= of.valid[1], bend *= of.valid[2];
  for (int k = 0; errors_weight && k < LOADS; k++) {
    c[1 + k] = errors_weight[k] * exp(of.y[1 + k]);
    on_u += errors_weight[k] * growth[k] * of.grown[1], bend += errors_weight[k] * growth[k] * of.grown[2];
  }
  on_far = SHARPNESS * on_u * of.by_far, c[0] = on_u * (1.0 - of.by_far);
  confidence_hessian(q, c, of.y, by_q, by_q2);
  ROOTS_OF(hessian)(pose, 0, by_q + 6, hessian);
  for (int k = 1; errors_weight && k <= LOADS; k++) {
    for (int i = 0; i < INNER; i++) for (int j = 0; j < INNER; j++) by_q2[INNER * i + j] += c[k] * by.dy[k][i] * by.dy[k][j];
  }
  add_through(INNER, by_q2, by.by_pose, hessian);
  /* the distance bends by W^T (1 - covariance of the centres) W */
  curvature(6, PADDED_CENTRES, of.share, centres[0], sums);
  curved(6, sums, spread);
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j <= i; j++) spread[6 * i + j] = on_far * ((i == j) - spread[6 * i + j] + of.mean[i] * of.mean[j]);
  }
  add_through(6, spread, (double(*)[6])whitening, hessian);
  for (int i = 0; i < 6; i++) {
    for (int j = 0; j < 6; j++) {
      const double apart = (by.d_far[i] - by.d_class[i]) * (by.d_far[j] - by.d_class[j]);
      hessian[6 * i + j] += on_u * of.by_far * (1.0 - of.by_far) * apart + bend * by.du[i] * by.du[j];
    }
  }
}
