/* Depth and its slopes at the nodes of a patch, four at a time: the formulas of contact/cells/quadrature.py. All
 * vectors are in the axes of the moving body, in which a twist (v, omega) changes the place q of a fixed point by
 * -v - omega x q, and a fixed direction w by -omega x w. */
typedef struct {
  double c[3], n[3], along[2][3], bend[2][3], loads[7];
} Node;

typedef struct {
  Lanes n[3], along[2][3], bend[2][3];          /* directions of the fixed surface at the nodes */
  Lanes q[3], start, moves;                     /* where the distance is taken, at c - start n; moves: 1 or 0 */
  Lanes sigma, m, m_slope, m_bend, d, value[3]; /* value: d, d_u, d_v as cells take them */
  Lanes near_slope, near_bend, near_third;
  Distance at;
} Depth;

INLINE Lanes positive_ramp(Lanes x, double width, Lanes *slope, Lanes *bend, Lanes *third) {
  const Lanes u = smaller_of(larger_of(x * (1.0 / width), all(-1.0)), all(1.0)), up = u + 1.0;
  const Mask outside = (x > width) | (x < -width);
  *slope = 0.25 * up * up * (2.0 - u);
  *bend = 0.75 / width * (1.0 - u * u);
  *third = pick(outside, all(0.0), -1.5 / (width * width) * u);
  return pick(x > width, x, width / 16.0 * up * up * up * (3.0 - u));
}

INLINE void to_fixed(const Frame *frame, const double twist[6], double turned[6]) {
  for (int i = 0; i < 3; i++) {
    turned[i] = dot3(frame->r[i], twist);
    turned[3 + i] = dot3(frame->r[i], twist + 3);
  }
}

INLINE void gather(const Node *nodes, const int *ids, size_t offset, Lanes w[3]) {
  for (int l = 0; l < BLOCK; l++) {
    const double *from = (const double *)((const char *)(nodes + ids[l]) + offset);
    for (int i = 0; i < 3; i++) w[i][l] = from[i];
  }
}

/* H w */
INLINE void bend_of(const Distance *at, const Lanes w[3], Lanes bent[3]) {
  const Lanes *h = at->bend;
  bent[0] = h[0] * w[0] + h[1] * w[1] + h[2] * w[2];
  bent[1] = h[1] * w[0] + h[3] * w[1] + h[4] * w[2];
  bent[2] = h[2] * w[0] + h[4] * w[1] + h[5] * w[2];
}

INLINE void floor_of_sigma(Depth *at) {
  Lanes unused;
  at->sigma = -dot_of(at->at.slope, at->n);
  at->m = FLATTEST + positive_ramp(at->sigma - FLATTEST, FLATTEST_WIDTH, &at->m_slope, &at->m_bend, &unused);
}

/* Everything at four nodes, with derivatives of the distance up to an order (1: values alone). */
INLINE void depth_at(const Node *nodes, const int *ids, const double *pose, const Frame *frame, int order, Depth *at) {
  Lanes w[3], q[3], first, near;
  gather(nodes, ids, offsetof(Node, c), w);
  to_place(w, pose, frame, q);
  gather(nodes, ids, offsetof(Node, n), w);
  to_body(frame, w, at->n);
  for (int a = 0; a < 2; a++) {
    gather(nodes, ids, offsetof(Node, along) + a * sizeof(double[3]), w);
    to_body(frame, w, at->along[a]);
    gather(nodes, ids, offsetof(Node, bend) + a * sizeof(double[3]), w);
    to_body(frame, w, at->bend[a]);
  }
  distance_at(q, 1, &at->at);
  floor_of_sigma(at);
  first = pick(at->sigma > FLATTEST + FLATTEST_WIDTH, -at->at.g / at->m, all(0.0));
  at->start = smaller_of(larger_of(first, all(-HIGHEST_START)), all(DEEPEST_START));
  at->moves = pick((at->start == first) & (first != 0.0), all(1.0), all(0.0));
  for (int i = 0; i < 3; i++) at->q[i] = q[i] - at->start * at->n[i];
  distance_at(at->q, order, &at->at);
  floor_of_sigma(at);
  at->d = at->start - at->at.g / at->m;
  near = positive_ramp(at->d + FAR_DEPTH, FAR_WIDTH, &at->near_slope, &at->near_bend, &at->near_third);
  at->value[0] = near - FAR_DEPTH;
  for (int a = 0; a < 2; a++) {
    at->value[1 + a] = at->near_slope / at->m *
                       (at->d * dot_of(at->at.slope, at->bend[a]) - dot_of(at->at.slope, at->along[a]));
  }
}

INLINE void cross_of(const Lanes a[3], const Lanes b[3], Lanes c[3]) {
  for (int i = 0; i < 3; i++) {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    c[i] = a[j] * b[k] - a[k] * b[j];
  }
}

/* gradient . w and its derivatives by twist where the point stays: (-H w, gradient x w - q x H w) */
FUNCTION Lanes slope_along(const Depth *at, const Lanes w[3], Lanes by[6]) {
  Lanes bent[3], turn[3], pull[3];
  bend_of(&at->at, w, bent);
  cross_of(at->at.slope, w, turn);
  cross_of(at->q, bent, pull);
  for (int i = 0; i < 3; i++) by[i] = -bent[i], by[3 + i] = turn[i] - pull[i];
  return dot_of(at->at.slope, w);
}

typedef struct {
  Lanes by_d[6], by_m[6], by_n[6], bent_n[3]; /* by_n: of gradient . n where the point stays */
} DepthSlopes;

FUNCTION void slopes_of_depth(const Depth *at, DepthSlopes *by) {
  Lanes twist[6], curved, late = (at->d - at->start) * at->m_slope;
  slope_along(at, at->n, by->by_n);
  bend_of(&at->at, at->n, by->bent_n);
  curved = at->moves * dot_of(at->n, by->bent_n);
  twist_of(at->at.slope, at->q, twist);
  for (int k = 0; k < 6; k++) {
    by->by_d[k] = (twist[k] + late * by->by_n[k]) / at->m;
    by->by_m[k] = -at->m_slope * (by->by_n[k] - curved * by->by_d[k]);
  }
}

/* Derivatives of gradient . w where the point goes along with the depth */
INLINE Lanes moving_slope_along(const Depth *at, const DepthSlopes *by, const Lanes w[3], Lanes slope[6]) {
  const Lanes value = slope_along(at, w, slope), curved = at->moves * dot_of(w, by->bent_n);
  for (int k = 0; k < 6; k++) slope[k] -= curved * by->by_d[k];
  return value;
}

/* Derivatives of the three values by twist */
INLINE void value_slopes(const Depth *at, Lanes slopes[3][6]) {
  const Lanes inverse = 1.0 / at->m;
  DepthSlopes by;
  slopes_of_depth(at, &by);
  for (int k = 0; k < 6; k++) slopes[0][k] = at->near_slope * by.by_d[k];
  for (int a = 0; a < 2; a++) {
    Lanes along[6], bend[6], slope;
    const Lanes of_along = moving_slope_along(at, &by, at->along[a], along);
    const Lanes of_bend = moving_slope_along(at, &by, at->bend[a], bend);
    slope = (at->d * of_bend - of_along) * inverse;
    for (int k = 0; k < 6; k++) {
      const Lanes rest = of_bend * by.by_d[k] + at->d * bend[k] - along[k] - slope * by.by_m[k];
      slopes[1 + a][k] = at->near_slope * inverse * rest + at->near_bend * slope * by.by_d[k];
    }
  }
}
