/* Depth and its slopes at the nodes of a patch, BLOCK at a time: the formulas of contact/cells/quadrature.py. All
 * vectors are in the axes of the moving body, in which a twist (v, omega) changes the place q of a fixed point by
 * -v - omega x q, and a fixed direction w by -omega x w. */
typedef struct {
  double c[3];
  float n[3], along[2][3], unused, bend[2][3], loads[8]; /* whole lines of the cache: the first for a first evaluation */
  float unused_2[2];
} Node;

typedef struct {
  Lanes n[3], along[2][3], bend[2][3], slope[3]; /* of the fixed surface, and the distance's gradient: fixed axes */
  Lanes q[3], start, moves, bends;               /* the distance is taken at c - start n; slopes of start by -g at c */
  Lanes node_q[3], node_slope[3];                /* c, and the distance's gradient there */
  Lanes sigma, m, m_slope, m_bend, d, value[3];  /* value: d, d_u, d_v as cells take them */
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

INLINE void places_of(const Node *nodes, const int *ids, Lanes c[3]) {
  Four row[BLOCK];
  Lanes column[4];
  for (int l = 0; l < BLOCK; l++) row[l] = four_at(nodes[ids[l]].c); /* the fourth is none */
  to_columns(row, column);
  memcpy(c, column, sizeof(Lanes[3]));
}

/* The fixed surface at BLOCK nodes: what is stored in single precision, one after the other */
INLINE void surface_of(const Node *nodes, const int *ids, Depth *at) {
  Lanes column[4][4];
  for (int k = 0; k < 4; k++) {
    const float *row[BLOCK];
    for (int l = 0; l < BLOCK; l++) row[l] = (const float *)((const char *)(nodes + ids[l]) + offsetof(Node, n)) + 4 * k;
    singles_to_columns(row, column[k]);
  }
  memcpy(at->n, column[0], sizeof at->n);
  memcpy(at->along, column[0] + 3, sizeof at->along);
  memcpy(at->bend, column[0] + 10, sizeof at->bend);
}

/* H w */
INLINE void bend_of(const Distance *at, const Lanes w[3], Lanes bent[3]) {
  const Lanes *h = at->bend;
  bent[0] = h[0] * w[0] + h[1] * w[1] + h[2] * w[2];
  bent[1] = h[1] * w[0] + h[3] * w[1] + h[4] * w[2];
  bent[2] = h[2] * w[0] + h[4] * w[1] + h[5] * w[2];
}

/* Where along the ray the distance is taken: at the node where that is near the surface, else short of it. */
INLINE void begin_ray(Lanes overlap, Depth *at) {
  Lanes unused;
  const Mask under = overlap > 0.0;
  const Lanes most = pick(under, all(DEEPEST_START), all(HIGHEST_START));
  const Lanes away = positive_ramp(size_of(overlap) - SMALL_DEPTH, SMALL_DEPTH_WIDTH, &at->moves, &at->bends, &unused);
  const Mask free = away < most;
  at->start = pick(free, away, most), at->moves = pick(free, at->moves, all(0.0));
  at->bends = pick(free, at->bends, all(0.0));
  at->start = pick(under, at->start, -at->start), at->bends = pick(under, at->bends, -at->bends);
}

/* What follows at BLOCK nodes from the surface, the start and the distance: all but `node_slope` */
INLINE void finish_depth(const Frame *frame, Depth *at) {
  Lanes near, unused, inverse;
  to_axes(frame, at->at.slope, at->slope);
  at->sigma = -dot_of(at->slope, at->n);
  at->m = FLATTEST + positive_ramp(at->sigma - FLATTEST, FLATTEST_WIDTH, &at->m_slope, &at->m_bend, &unused);
  inverse = 1.0 / at->m;
  at->d = at->start - at->at.g * inverse;
  near = positive_ramp(at->d + FAR_DEPTH, FAR_WIDTH, &at->near_slope, &at->near_bend, &at->near_third);
  at->value[0] = near - FAR_DEPTH;
  for (int a = 0; a < 2; a++) {
    at->value[1 + a] = at->near_slope * inverse *
                       (at->d * dot_of(at->slope, at->bend[a]) - dot_of(at->slope, at->along[a]));
  }
}

/* A second evaluation at BLOCK nodes, with derivatives of g up to an order (1: none). overlap: -g at the nodes. */
INLINE void depth_at(const Node *nodes, const int *ids, Lanes overlap, const double *pose, const Frame *frame, int order,
                     Depth *at) {
  Lanes c[3];
  places_of(nodes, ids, c);
  surface_of(nodes, ids, at);
  to_place(c, pose, frame, at->node_q);
  begin_ray(overlap, at);
  for (int i = 0; i < 3; i++) c[i] -= at->start * at->n[i];
  to_place(c, pose, frame, at->q);
  distance_at(at->q, order, &at->at);
  finish_depth(frame, at);
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
  Lanes overlap[6], start[6], d[6], sigma[6], stays[6]; /* derivatives by twist; stays: of gradient . n at a fixed point */
  Lanes n[3], bent_n[3];                                /* body axes */
} DepthSlopes;

/* From m (d - start) + g = 0 */
FUNCTION void slopes_of_depth(const Depth *at, const Frame *frame, DepthSlopes *by) {
  const Lanes inverse = 1.0 / at->m, late = at->d - at->start;
  Lanes twist[6], curved;
  to_body(frame, at->n, by->n);
  slope_along(at, by->n, by->stays);
  bend_of(&at->at, by->n, by->bent_n);
  curved = dot_of(by->n, by->bent_n);
  twist_of(at->at.slope, at->q, twist);
  twist_of(at->node_slope, at->node_q, by->overlap);
  for (int k = 0; k < 6; k++) {
    by->start[k] = at->moves * by->overlap[k];
    by->sigma[k] = curved * by->start[k] - by->stays[k];
    by->d[k] = (twist[k] + (at->m - at->sigma) * by->start[k] - late * at->m_slope * by->sigma[k]) * inverse;
  }
}

/* Derivatives of gradient . w where the point goes along with the start */
INLINE Lanes moving_slope_along(const Depth *at, const DepthSlopes *by, const Lanes w[3], Lanes slope[6]) {
  const Lanes value = slope_along(at, w, slope), curved = dot_of(w, by->bent_n);
  for (int k = 0; k < 6; k++) slope[k] -= curved * by->start[k];
  return value;
}

/* Derivatives of the three values by twist */
INLINE void value_slopes(const Depth *at, const Frame *frame, Lanes slopes[3][6]) {
  const Lanes inverse = 1.0 / at->m;
  DepthSlopes by;
  slopes_of_depth(at, frame, &by);
  for (int k = 0; k < 6; k++) slopes[0][k] = at->near_slope * by.d[k];
  for (int a = 0; a < 2; a++) {
    const Lanes of_bend = dot_of(at->slope, at->bend[a]);
    Lanes fixed[3], w[3], along[6], slope;
    for (int i = 0; i < 3; i++) fixed[i] = at->d * at->bend[a][i] - at->along[a][i];
    to_body(frame, fixed, w);
    slope = moving_slope_along(at, &by, w, along) * inverse;
    for (int k = 0; k < 6; k++) {
      const Lanes rest = of_bend * by.d[k] + along[k] - slope * at->m_slope * by.sigma[k];
      slopes[1 + a][k] = at->near_slope * inverse * rest + at->near_bend * slope * by.d[k];
    }
  }
}
