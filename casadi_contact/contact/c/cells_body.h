INLINE void to_body(const Frame *frame, const Lanes w[3], Lanes turned[3]) {
  for (int j = 0; j < 3; j++) turned[j] = frame->r[0][j] * w[0] + frame->r[1][j] * w[1] + frame->r[2][j] * w[2];
}

INLINE void to_axes(const Frame *frame, const Lanes w[3], Lanes turned[3]) {
  for (int i = 0; i < 3; i++) turned[i] = frame->r[i][0] * w[0] + frame->r[i][1] * w[1] + frame->r[i][2] * w[2];
}

/* Points of the fixed frame in that of the body */
INLINE void to_place(const Lanes point[3], const double *pose, const Frame *frame, Lanes q[3]) {
  const Lanes from[3] = {point[0] - pose[0], point[1] - pose[1], point[2] - pose[2]};
  to_body(frame, from, q);
}

/* Signed distance g of the moving body at BLOCK points of its frame, with derivatives up to an order: gradient, second
 * (xx xy xz yy yz zz) and third ones (xxx xxy xxz xyy xyz xzz yyy yyz yzz zzz). The formulas of
 * geometry/distance_field.py and geometry/field_derivatives.py. */
typedef struct {
  Lanes g, slope[3], bend[6], third[10];
} Distance;

#if BODY_FIELD
/* Weights of the four nodes around shares t of a cubic B-spline's cell, and their derivatives in units of the cell. */
INLINE void spline_weights(Lanes t, int order, Lanes w[4][4]) {
  const Lanes s = 1.0 - t, s2 = s * s, t2 = t * t;
  w[0][0] = 1.0 / 6.0 * s * s2, w[0][3] = 1.0 / 6.0 * t * t2;
  w[0][1] = 4.0 / 6.0 - t2 * (1.0 - 0.5 * t), w[0][2] = 4.0 / 6.0 - s2 * (1.0 - 0.5 * s);
  w[1][0] = -0.5 * s2, w[1][1] = t * (1.5 * t - 2.0), w[1][2] = s * (2.0 - 1.5 * s), w[1][3] = 0.5 * t2;
  if (order >= 2) w[2][0] = s, w[2][1] = 3.0 * t - 2.0, w[2][2] = 3.0 * s - 2.0, w[2][3] = t;
  if (order >= 3) w[3][0] = all(-1.0), w[3][1] = all(3.0), w[3][2] = all(-3.0), w[3][3] = all(1.0);
}

/* Places on the grid along one axis: the first of the four nodes and the share of the cell; what lies beyond the grid.
 * What is not a number counts as the grid's beginning. */
INLINE Lanes place_on(Lanes coordinate, int count, Lanes *share, Lanes *beyond) {
  const Lanes within = smaller_of(larger_of(coordinate, all(1.0)), all(count - 2.0));
  const Lanes node = smaller_of(larger_of(nearest_whole(within - 0.5), all(1.0)), all(count - 3.0));
  *share = within - node;
  *beyond = coordinate - within;
  return node - 1.0;
}

FUNCTION void leave_grid(const Lanes beyond[3], int order, Distance *out) {
  static const int axes[6][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}};
  const Lanes out_by = root(dot_of(beyond, beyond));
  const Mask is_out = out_by != 0.0;
  out->g += out_by * FIELD_SPACING;
  for (int i = 0; i < 3; i++) out->slope[i] = pick(beyond[i] != 0.0, beyond[i] / out_by, out->slope[i]);
  for (int k = 0; k < 6 && order >= 2; k++) {
    out->bend[k] = pick((beyond[axes[k][0]] != 0.0) | (beyond[axes[k][1]] != 0.0), all(0.0), out->bend[k]);
  }
  for (int k = 0; k < 10 && order >= 3; k++) out->third[k] = pick(is_out, all(0.0), out->third[k]);
}

/* Four coefficients along z of a lane, and of the fourth after it where there are eight */
INLINE Lanes rows_at(const float *first, const float *second) {
#if BLOCK == 8
  return _mm512_cvtps_pd(_mm256_loadu2_m128(second, first));
#else
  (void)second;
  return four_singles_at(first);
#endif
}

/* What they are multiplied by */
INLINE Lanes for_rows(Lanes weight, int lane) {
#if BLOCK == 8
  const Mask lanes = {lane, lane, lane, lane, lane + 4, lane + 4, lane + 4, lane + 4};
  return _mm512_permutexvar_pd((__m512i)lanes, weight);
#else
  return all(weight[lane]);
#endif
}

/* By order along x and y, 00 10 01 20 11 02 30 21 12 03: sums of the 16 rows about the points of such lanes, along z */
INLINE void sum_rows(const float *first, const float *second, int lane, int order, const Lanes x[4][4], const Lanes y[4][4],
                     Lanes sums[10][4]) {
  Lanes sum[10], of_x[4][4];
  for (int m = 0; m <= order; m++) for (int p = 0; p < 4; p++) of_x[m][p] = for_rows(x[m][p], lane);
  for (int r = 0; r < 4; r++) {
    Lanes along_x[4], of_y[4];
    for (int p = 0; p < 4; p++) {
      const int row = (p * FIELD_Y + r) * FIELD_Z;
      const Lanes rows = rows_at(first + row, second + row);
      for (int m = 0; m <= order; m++) along_x[m] = p ? along_x[m] + of_x[m][p] * rows : of_x[m][p] * rows;
    }
    for (int m = 0; m <= order; m++) of_y[m] = for_rows(y[m][r], lane);
    for (int n = 0, total = 0; total <= order; total++) {
      for (int m = 0; m <= total; m++, n++) {
        const Lanes part = of_y[m] * along_x[total - m];
        sum[n] = r ? sum[n] + part : part;
      }
    }
  }
  for (int n = 0; n < (order + 1) * (order + 2) / 2; n++) sums[n][lane] = sum[n];
}

/* Where BLOCK points lie on the grid: the first of the coefficients about each, shares of their cells, what lies beyond */
typedef struct {
  Lanes share[3], beyond[3];
  Whole first;
  int is_out; /* any of them */
} Spot;

INLINE void spot_of(const Lanes q[3], Spot *spot) {
  const int counts[3] = {FIELD_X, FIELD_Y, FIELD_Z};
  Lanes node[3];
  for (int i = 0; i < 3; i++) {
    const Lanes along = (q[i] - field_origin[i]) * (1.0 / FIELD_SPACING);
    node[i] = place_on(along, counts[i], spot->share + i, spot->beyond + i);
  }
  spot->first = __builtin_convertvector((node[0] * FIELD_Y + node[1]) * FIELD_Z + node[2], Whole);
  spot->is_out = any((spot->beyond[0] != 0.0) | (spot->beyond[1] != 0.0) | (spot->beyond[2] != 0.0));
}

INLINE void field_at(const Spot *spot, int order, Distance *out) {
  /* Of g, its slopes, second and third derivatives: the sum of rows, and the order along z */
  static const int of[20] = {0, 1, 2, 0, 3, 4, 1, 5, 2, 0, 6, 7, 3, 8, 4, 1, 9, 5, 2, 0};
  static const int along_z[20] = {0, 0, 0, 1, 0, 0, 1, 0, 1, 2, 0, 0, 1, 0, 1, 2, 0, 1, 2, 3};
  const int wanted = order == 1 ? 4 : (order == 2 ? 10 : 20);
  const double s = 1.0 / FIELD_SPACING;
  Lanes weights[3][4][4], sums[10][4], columns[10][4], found[20];
  for (int i = 0; i < 3; i++) spline_weights(spot->share[i], order, weights[i]);
  KEEP_LOOP for (int l = 0; l < 4; l++) {
    const float *first = FIELD_COEFFICIENTS + spot->first[l], *second = FIELD_COEFFICIENTS + spot->first[BLOCK - 4 + l];
    sum_rows(first, second, l, order, weights[0], weights[1], sums);
  }
  for (int n = 0; n < (order + 1) * (order + 2) / 2; n++) transpose(sums[n], columns[n]);
  for (int k = 0; k < wanted; k++) {
    const Lanes *column = columns[of[k]], *weight = weights[2][along_z[k]];
    found[k] = column[0] * weight[0] + column[1] * weight[1] + (column[2] * weight[2] + column[3] * weight[3]);
  }
  out->g = found[0];
  for (int i = 0; i < 3; i++) out->slope[i] = s * found[1 + i];
  for (int k = 0; k < 6 && order >= 2; k++) out->bend[k] = s * s * found[4 + k];
  for (int k = 0; k < 10 && order >= 3; k++) out->third[k] = s * s * s * found[10 + k];
  if (spot->is_out) leave_grid(spot->beyond, order, out);
}

INLINE void fields_at(const Lanes q[3], int order, Distance *out) {
  Spot spot;
  spot_of(q, &spot);
  field_at(&spot, order, out);
}

/* One function for each order, not inlined: compiling is quick. */
FUNCTION void field_first(const Lanes q[3], Distance *out) { fields_at(q, 1, out); }
FUNCTION void field_second(const Lanes q[3], Distance *out) { fields_at(q, 2, out); }
FUNCTION void field_third(const Lanes q[3], Distance *out) { fields_at(q, 3, out); }

INLINE void distance_at(const Lanes q[3], int order, Distance *out) {
  if (order == 1) field_first(q, out);
  if (order == 2) field_second(q, out);
  if (order == 3) field_third(q, out);
}

#else
typedef struct {
  Lanes q[3];
} Spot;
INLINE void spot_of(const Lanes q[3], Spot *spot) { memcpy(spot->q, q, sizeof spot->q); }
INLINE void distance_at(const Lanes q[3], int order, Distance *out);
INLINE void field_at(const Spot *spot, int order, Distance *out) { distance_at(spot->q, order, out); }

#if BODY_ROUND
/* A ball or a cylinder: g = |P (q - centre)| - radius */
INLINE void distance_at(const Lanes q[3], int order, Distance *out) {
  Lanes e[3], far = all(0.0), inverse;
  for (int i = 0; i < 3; i++) e[i] = round_axes[i] * (q[i] - round_centre[i]), far += e[i] * e[i];
  far = larger_of(root(far), all(1e-12));
  inverse = 1.0 / far;
  out->g = far - ROUND_RADIUS;
  for (int i = 0; i < 3; i++) out->slope[i] = e[i] *= inverse;
  for (int i = 0, n = 0; i < 3 && order >= 2; i++) {
    for (int j = i; j < 3; j++) out->bend[n++] = ((i == j ? round_axes[i] : 0.0) - e[i] * e[j]) * inverse;
  }
  for (int i = 0, n = 0; i < 3 && order >= 3; i++) {
    for (int j = i; j < 3; j++) {
      for (int k = j; k < 3; k++) {
        const double ij = i == j ? round_axes[i] : 0.0, ik = i == k ? round_axes[i] : 0.0;
        const double jk = j == k ? round_axes[j] : 0.0;
        out->third[n++] = (3.0 * e[i] * e[j] * e[k] - ij * e[k] - ik * e[j] - jk * e[i]) * inverse * inverse;
      }
    }
  }
}
#else
/* All that lies at SOLID_SIDE y >= 0 of the moving frame */
INLINE void distance_at(const Lanes q[3], int order, Distance *out) {
  memset(out, 0, sizeof *out);
  out->g = -SOLID_SIDE * q[1];
  out->slope[1] = all(-SOLID_SIDE);
  (void)order;
}
#endif
#endif
