/* Signed distance g of the moving body at four points of its frame, with derivatives up to an order: gradient, second
 * (xx xy xz yy yz zz) and third ones (xxx xxy xxz xyy xyz xzz yyy yyz yzz zzz). The formulas of
 * geometry/distance_field.py and geometry/field_derivatives.py. */
typedef struct {
  Lanes g, slope[3], bend[6], third[10];
} Distance;

#if BODY_FIELD
typedef struct {
  float g, slope[3], bow;
} Tangent; /* of the field at a node */

typedef double Row __attribute__((vector_size(8 * BLOCK), aligned(8))); /* four coefficients along z, wherever */
INLINE Lanes row_of(const double *c) { return *(const Row *)c; }
INLINE Lanes weigh(const Lanes w, const Lanes rows[4]) {
  return (w[0] * rows[0] + w[1] * rows[1]) + (w[2] * rows[2] + w[3] * rows[3]);
}

/* Weights of the four nodes around share t of a cubic B-spline's cell, and their derivatives in units of the cell. */
INLINE void spline_weights(double t, int order, Lanes w[4]) {
  const Lanes a = {1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0, 0.0}, b = {-0.5, 0.0, 0.5, 0.0}, c = {0.5, -1.0, 0.5, 0.0};
  const Lanes d = {-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0};
  w[0] = a + t * (b + t * (c + t * d));
  w[1] = b + t * (2.0 * c + (3.0 * t) * d);
  if (order >= 2) w[2] = 2.0 * c + (6.0 * t) * d;
  if (order >= 3) w[3] = 6.0 * d;
}

/* Place on the grid along one axis: the first of its four nodes and the share of the cell; what lies beyond the grid.
 * What is not a number counts as the grid's beginning. */
INLINE int place_on(double coordinate, int count, double *share, double *beyond) {
  const double least = coordinate > 1.0 ? coordinate : 1.0, within = least > count - 2.0 ? count - 2.0 : least;
  const int first = (int)within, last = count - 3, node = first < last ? first : last;
  *share = within - node;
  *beyond = coordinate - within;
  return node - 1;
}

INLINE void leave_grid(const double beyond[3], int lane, int order, Distance *out) {
  static const int axes[6][2] = {{0, 0}, {0, 1}, {0, 2}, {1, 1}, {1, 2}, {2, 2}};
  const double out_by = sqrt(beyond[0] * beyond[0] + beyond[1] * beyond[1] + beyond[2] * beyond[2]);
  out->g[lane] += out_by * FIELD_SPACING;
  for (int i = 0; i < 3; i++) {
    if (beyond[i] != 0.0) out->slope[i][lane] = beyond[i] / out_by;
  }
  for (int k = 0; k < 6 && order >= 2; k++) {
    if (beyond[axes[k][0]] != 0.0 || beyond[axes[k][1]] != 0.0) out->bend[k][lane] = 0.0;
  }
  for (int k = 0; k < 10 && order >= 3; k++) out->third[k][lane] = 0.0;
}

INLINE void field_at(const double place[3], int lane, int order, Distance *out) {
  const double s = 1.0 / FIELD_SPACING, s2 = s * s, s3 = s2 * s;
  double share[3], beyond[3];
  Lanes x[4], y[4], z[4], v[10] = {{0.0}};
  const int i = place_on(place[0], FIELD_X, share, beyond), j = place_on(place[1], FIELD_Y, share + 1, beyond + 1);
  const int k = place_on(place[2], FIELD_Z, share + 2, beyond + 2);
  const double *c = FIELD_COEFFICIENTS + ((long long)i * FIELD_Y + j) * FIELD_Z + k;
  spline_weights(share[0], order, x);
  spline_weights(share[1], order, y);
  spline_weights(share[2], order, z);
  for (int p = 0; p < 4; p++, c += FIELD_Y * FIELD_Z) { /* along x; v: by order along x, y: 00 10 01 20 11 02 30 ... */
    const Lanes rows[4] = {row_of(c), row_of(c + FIELD_Z), row_of(c + 2 * FIELD_Z), row_of(c + 3 * FIELD_Z)};
    const Lanes f = weigh(y[0], rows), f_y = weigh(y[1], rows);
    v[0] += x[0][p] * f, v[1] += x[1][p] * f, v[2] += x[0][p] * f_y;
    if (order >= 2) {
      const Lanes f_yy = weigh(y[2], rows);
      v[3] += x[2][p] * f, v[4] += x[1][p] * f_y, v[5] += x[0][p] * f_yy;
      if (order >= 3) {
        const Lanes f_yyy = weigh(y[3], rows);
        v[6] += x[3][p] * f, v[7] += x[2][p] * f_y, v[8] += x[1][p] * f_yy, v[9] += x[0][p] * f_yyy;
      }
    }
  }
  out->g[lane] = sum_of(v[0] * z[0]);
  out->slope[0][lane] = s * sum_of(v[1] * z[0]);
  out->slope[1][lane] = s * sum_of(v[2] * z[0]);
  out->slope[2][lane] = s * sum_of(v[0] * z[1]);
  if (order >= 2) {
    out->bend[0][lane] = s2 * sum_of(v[3] * z[0]);
    out->bend[1][lane] = s2 * sum_of(v[4] * z[0]);
    out->bend[2][lane] = s2 * sum_of(v[1] * z[1]);
    out->bend[3][lane] = s2 * sum_of(v[5] * z[0]);
    out->bend[4][lane] = s2 * sum_of(v[2] * z[1]);
    out->bend[5][lane] = s2 * sum_of(v[0] * z[2]);
  }
  if (order >= 3) {
    static const int of[10] = {6, 7, 3, 8, 4, 1, 9, 5, 2, 0}, along_z[10] = {0, 0, 1, 0, 1, 2, 0, 1, 2, 3};
    for (int n = 0; n < 10; n++) out->third[n][lane] = s3 * sum_of(v[of[n]] * z[along_z[n]]);
  }
  if (beyond[0] != 0.0 || beyond[1] != 0.0 || beyond[2] != 0.0) leave_grid(beyond, lane, order, out);
}

INLINE void fields_at(const Lanes q[3], int order, Distance *out) {
  const double s = 1.0 / FIELD_SPACING;
  const Lanes place[3] = {(q[0] - field_origin[0]) * s, (q[1] - field_origin[1]) * s, (q[2] - field_origin[2]) * s};
  KEEP_LOOP for (int l = 0; l < BLOCK; l++) {
    const double at[3] = {place[0][l], place[1][l], place[2][l]};
    field_at(at, l, order, out);
  }
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

#ifdef FIELD_TANGENTS
/* Whether the body may come within TOUCH of a box about a point, sides in the fixed frame: by value, slope and bow of
 * the field at the node nearest to the point (see contact/cells/tangents.py), without a look at the spline. */
INLINE int may_touch(const double q[3], const double half[3], const Frame *frame) {
  const int counts[3] = {FIELD_X, FIELD_Y, FIELD_Z};
  const double size = sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]);
  double away[3], way = 0.0, least, turned[3];
  const Tangent *at;
  long long node = 0;
  for (int i = 0; i < 3; i++) {
    const double place = (q[i] - field_origin[i]) * (1.0 / FIELD_SPACING);
    const double least = place > 0.0 ? place : 0.0, within = least > counts[i] - 1.0 ? counts[i] - 1.0 : least;
    const int nearest = (int)(within + 0.5);
    away[i] = (place - nearest) * FIELD_SPACING, way += away[i] * away[i];
    node = node * counts[i] + nearest;
  }
  if (FIELD_INDEX[node] < 0) return FIELD_COEFFICIENTS[node] <= 0.0;
  at = FIELD_TANGENTS + FIELD_INDEX[node];
  way = sqrt(way) + size;
  if (way > BOW_REACH) return at->g - STEEPEST * way <= TOUCH;
  least = at->g - 0.5 * at->bow * way * way;
  for (int i = 0; i < 3; i++) {
    turned[i] = frame->r[i][0] * at->slope[0] + frame->r[i][1] * at->slope[1] + frame->r[i][2] * at->slope[2];
    least += at->slope[i] * away[i] - fabs(turned[i]) * half[i];
  }
  return least <= TOUCH;
}
#endif
#elif BODY_ROUND
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
/* All that lies at y >= 0 of the moving frame */
INLINE void distance_at(const Lanes q[3], int order, Distance *out) {
  memset(out, 0, sizeof *out);
  out->g = -q[1];
  out->slope[1] = all(-1.0);
  (void)order;
}
#endif

#ifndef FIELD_TANGENTS
INLINE int may_touch(const double q[3], const double half[3], const Frame *frame) {
  const Lanes at[3] = {all(q[0]), all(q[1]), all(q[2])};
  Distance found;
  distance_at(at, 1, &found);
  (void)frame;
  return found.g[0] - (BODY_FIELD ? STEEPEST : 1.0) * sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]) <= TOUCH;
}
#endif
