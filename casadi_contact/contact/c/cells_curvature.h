/* Second derivatives by twist, a first and b last, of a weighted sum of a patch's loads; axes of the moving body.
 *
 * Where a point q of the moving frame and a direction w belong to the fixed body, q_v = -v, q_omega = q x omega,
 * w_omega = w x omega, and of g and f = gradient . w
 *   g_ab = q_a H q_b + gradient . q_ab,
 *   f_ab = q_a T[w] q_b + (H w) . q_ab + (H q_a) . w_b + (H q_b) . w_a + gradient . w_ab,
 * with T the third derivatives; q_ab and w_ab are what `add_turning` adds. */
typedef struct {
  Lanes upper[6][6], force[3], arms[3][3];
} Curvature;

INLINE void third_of(const Distance *at, const Lanes w[3], Lanes t[6]) {
  const Lanes *d = at->third;
  t[0] = d[0] * w[0] + d[1] * w[1] + d[2] * w[2];
  t[1] = d[1] * w[0] + d[3] * w[1] + d[4] * w[2];
  t[2] = d[2] * w[0] + d[4] * w[1] + d[5] * w[2];
  t[3] = d[3] * w[0] + d[6] * w[1] + d[7] * w[2];
  t[4] = d[4] * w[0] + d[7] * w[1] + d[8] * w[2];
  t[5] = d[5] * w[0] + d[8] * w[1] + d[9] * w[2];
}

INLINE void symmetric_of(const Lanes h[6], Lanes m[3][3]) {
  m[0][0] = h[0], m[0][1] = m[1][0] = h[1], m[0][2] = m[2][0] = h[2];
  m[1][1] = h[3], m[1][2] = m[2][1] = h[4], m[2][2] = h[5];
}

/* q_a S q_b + (H q_a) . w_b + (H q_b) . w_a, and the turning of force and arms */
FUNCTION void add_curvature(const Lanes q[3], const Lanes s_of[6], const Distance *at, const Lanes w[3],
                          const Lanes force[3], Curvature *sum) {
  Lanes s[3][3], h[3][3], turn[3][3], both[3][3], pull[3][3];
  symmetric_of(s_of, s);
  symmetric_of(at->bend, h);
  for (int k = 0; k < 3; k++) {
    const Lanes axis[3] = {all(k == 0), all(k == 1), all(k == 2)};
    Lanes y[3];
    cross_of(q, axis, turn[k]);
    cross_of(w, axis, y);
    for (int i = 0; i < 3; i++) pull[k][i] = dot_of(h[i], y), both[k][i] = dot_of(s[i], turn[k]) + pull[k][i];
  }
  for (int i = 0; i < 3; i++) {
    sum->force[i] += force[i];
    for (int j = 0; j < 3; j++) {
      if (j >= i) sum->upper[i][j] += s[i][j], sum->upper[3 + i][3 + j] += dot_of(turn[i], both[j]) + dot_of(turn[j], pull[i]);
      sum->upper[i][3 + j] -= both[j][i];
      sum->arms[i][j] += force[i] * q[j] + at->slope[i] * w[j];
    }
  }
}

INLINE void finish_curvature(const Frame *frame, const Curvature *sum, double out[6][6]) {
  double h[6][6], half[6][6], column[6], turned[6], force[3], arms[3][3];
  for (int a = 0; a < 6; a++) for (int b = a; b < 6; b++) h[a][b] = h[b][a] = sum_of(sum->upper[a][b]);
  for (int i = 0; i < 3; i++) {
    force[i] = sum_of(sum->force[i]);
    for (int j = 0; j < 3; j++) arms[i][j] = sum_of(sum->arms[i][j]);
  }
  add_turning(force, arms, h);
  for (int a = 0; a < 6; a++) to_fixed(frame, h[a], half[a]);
  for (int b = 0; b < 6; b++) {
    for (int a = 0; a < 6; a++) column[a] = half[a][b];
    to_fixed(frame, column, turned);
    for (int a = 0; a < 6; a++) out[a][b] = turned[a];
  }
}

/* Of the start, whose first derivative counts `weight`, by -g at the node; node_bend: second derivatives of g there */
INLINE void add_start_curvature(const Depth *at, const Lanes node_bend[6], Lanes weight, Curvature *sum) {
  const Lanes nothing[3] = {{0.0}}, turned = -weight * at->moves;
  Distance node;
  Lanes force[3];
  for (int k = 0; k < 6; k++) node.bend[k] = turned * node_bend[k];
  for (int i = 0; i < 3; i++) node.slope[i] = force[i] = turned * at->node_slope[i];
  add_curvature(at->node_q, node.bend, &node, nothing, force, sum);
}

/* Of weighted values at BLOCK nodes: see the docstring of contact/cells/quadrature.py. To their sum -e times the equation
 * of the depth, m (d - start) + g = 0, is added, e such that their slope by d is zero: d then counts to first order
 * alone. What is left depends on f = gradient . w - e g at the point, and on the start that moves it along -n:
 * f_start = -w H n + e gradient . n, f_start,start = T[w] n n - e n H n, and its mixed derivatives `along_ray`. */
INLINE void add_node_curvature(const Depth *at, const Lanes node_bend[6], const Frame *frame, const Lanes weight[3],
                               Curvature *sum) {
  const Lanes inverse = 1.0 / at->m, late = at->d - at->start;
  Lanes by_a[6], by_b[6], by_slope[6], by_m[6], along_ray[6], beside[6], t[6];
  Lanes w_a[3], w_b[3], w[3], t_n[3], bent[3], turn[3], part[3];
  Lanes b, slope, e, square, by_start, force[3], m_term;
  DepthSlopes by;
  slopes_of_depth(at, frame, &by);
  for (int k = 0; k < 6; k++) by_m[k] = at->m_slope * by.sigma[k];
  for (int i = 0; i < 3; i++) {
    part[i] = -(weight[1] * at->along[0][i] + weight[2] * at->along[1][i]);
    turn[i] = weight[1] * at->bend[0][i] + weight[2] * at->bend[1][i];
  }
  to_body(frame, part, w_a);
  to_body(frame, turn, w_b);
  slope = moving_slope_along(at, &by, w_a, by_a);
  b = moving_slope_along(at, &by, w_b, by_b);
  slope = (slope + at->d * b) * inverse;
  for (int k = 0; k < 6; k++) by_slope[k] = (by_a[k] + at->d * by_b[k] + b * by.d[k] - slope * by_m[k]) * inverse;
  for (int i = 0; i < 3; i++) {
    w[i] = at->near_slope * inverse * (w_a[i] + at->d * w_b[i] + slope * at->m_slope * by.n[i]);
  }
  e = (weight[0] * at->near_slope + at->near_bend * slope + at->near_slope * b * inverse) * inverse;
  for (int i = 0; i < 3; i++) w[i] += e * late * at->m_slope * by.n[i];
  bend_of(&at->at, w, bent);
  third_of(&at->at, w, t);
  for (int i = 0; i < 3; i++) {
    Lanes rows[3][3];
    symmetric_of(t, rows);
    t_n[i] = dot_of(rows[i], by.n);
  }
  cross_of(t_n, at->q, turn);
  cross_of(by.bent_n, w, part);
  for (int i = 0; i < 3; i++) turn[i] += part[i];
  cross_of(bent, by.n, part);
  for (int i = 0; i < 3; i++) along_ray[i] = t_n[i], along_ray[3 + i] = -(turn[i] + part[i]);
  square = weight[0] * at->near_bend + at->near_third * slope;
  by_start = e * (at->m - at->sigma) - dot_of(w, by.bent_n);
  for (int k = 0; k < 6; k++) {
    beside[k] = 0.5 * square * by.d[k] + at->near_bend * by_slope[k] + at->near_slope * inverse * by_b[k] - e * by_m[k];
    along_ray[k] += 0.5 * (dot_of(t_n, by.n) - e * dot_of(by.n, by.bent_n)) * by.start[k] + e * (by.stays[k] + by_m[k]);
    along_ray[k] = at->moves * along_ray[k] + 0.5 * at->bends * by_start * by.overlap[k];
  }
  m_term = -at->m_bend * (at->near_slope * slope * inverse + e * late);
  for (int k = 0; k < 6; k++) {
    for (int l = k; l < 6; l++) {
      sum->upper[k][l] += by.d[k] * beside[l] + beside[k] * by.d[l] + m_term * by.sigma[k] * by.sigma[l] +
                          by.overlap[k] * along_ray[l] + along_ray[k] * by.overlap[l] -
                          at->near_slope * inverse * (by_m[k] * by_slope[l] + by_slope[k] * by_m[l]);
    }
  }
  for (int k = 0; k < 6; k++) t[k] -= e * at->at.bend[k];
  for (int i = 0; i < 3; i++) force[i] = bent[i] - e * at->at.slope[i];
  add_curvature(at->q, t, &at->at, w, force, sum);
  if (any(at->moves != 0.0)) add_start_curvature(at, node_bend, by_start, sum);
}

/* What BLOCK cells add by themselves, and the weights of their corners' values */
INLINE void add_cell_curvature(const Patch *p, Scratch *s, const int *chosen, int count, int full, Lanes h[6][PARTS]) {
  const Presence present = presence_of(p, s, chosen, count);
  Lanes v[12], unused[4], pull[4], rate[12];
  corner_values(s, chosen, v, unused);
  for (int c = 0; c < 4; c++) for (int l = 0; l < BLOCK; l++) pull[c][l] = s->share[s->corners[chosen[l]][c]][7];
  for (int j = 0; j < 12; j++) {
    rate[j] = all(0.0);
    for (int c = 0; c < 4 && full; c++) rate[j] += whole[c][j] * pull[c];
  }
  for (int r = 0; r < SUB_POINTS && !full; r++) {
    Lanes slope, bend, stiffness, stiffening, twice, weight = all(0.0);
    const Lanes depth = ramp(depth_of(v, r), &slope, &bend);
    for (int c = 0; c < 4; c++) weight += share[r][c] * pull[c];
    weight *= present_at(&present, r);
    soft_pressure(depth, &stiffness, &stiffening);
    twice = weight * (stiffness * bend + stiffening * slope * slope);
    for (int j = 0; j < 12; j++) rate[j] += weight * stiffness * slope * hermite[r][j];
    for (int l = 0; l < count; l++) {
      Lanes x[PARTS];
      if (twice[l] == 0.0) continue;
      memset(x, 0, sizeof x);
      for (int j = 0; j < 12; j++) {
        const double *by = s->slopes[s->corners[chosen[l]][j / 3]][j % 3];
        for (int i = 0; i < PARTS; i++) x[i] += hermite[r][j] * lanes_at(by + i * BLOCK);
      }
      for (int a = 0; a < 6; a++) for (int i = 0; i < PARTS; i++) h[a][i] += twice[l] * x[a / BLOCK][a % BLOCK] * x[i];
    }
  }
  for (int c = 0; c < 4; c++) {
    const Lanes column[4] = {rate[3 * c], rate[3 * c + 1], rate[3 * c + 2], all(0.0)};
    Four row[BLOCK];
    to_rows(column, row);
    for (int l = 0; l < count; l++) {
      double *weight = s->weight[s->corners[chosen[l]][c]];
      const Four sum = four_at(weight) + row[l];
      memcpy(weight, &sum, sizeof sum);
    }
  }
}

/* After `contact_sums` with slopes in the same pose */
FUNCTION void contact_curvature(const Patch *p, const double *pose, const Frame *frame, const double weights[7],
                                Scratch *s, double out[6][6]) {
  Lanes h[6][PARTS];
  Curvature sum;
  memset(h, 0, sizeof h);
  memset(&sum, 0, sizeof sum);
  memset(s->weight, 0, (s->nodes + BLOCK) * sizeof s->weight[0]);
  for (int i = 0; i < s->nodes; i++) { /* the eighth is free: what a corner's share of pressure adds to the sum */
    const Load *loads = LOADS_AT(p, s, i);
    double pull = 0.0;
    for (int k = 0; k < 7; k++) pull -= weights[k] * loads[k];
    s->share[i][7] = pull;
  }
  for (int first = 0, count; first < s->cells; first += count < BLOCK ? count : BLOCK) {
    const int is_full = first < s->full;
    int chosen[BLOCK];
    count = (is_full ? s->full : s->cells) - first;
    for (int l = 0; l < BLOCK; l++) chosen[l] = s->chosen[l < count ? first + l : first];
    add_cell_curvature(p, s, chosen, count < BLOCK ? count : BLOCK, is_full, h);
  }
  for (int first = 0; first < s->nodes; first += BLOCK) {
    Lanes weight[4], overlap;
    Four row[BLOCK];
    int slots[BLOCK];
    Depth at;
    Distance node;
    memcpy(row, s->weight[first], sizeof row);
    to_columns(row, weight);
    if (sum_of(weight[0] * weight[0] + weight[1] * weight[1] + weight[2] * weight[2]) == 0.0) continue;
    for (int l = 0; l < BLOCK; l++) slots[l] = first + l;
    overlap = node_overlaps(s, slots);
    depth_at(p->nodes, s->ids + first, overlap, pose, frame, 3, &at);
    add_node_slopes(s, slots, &at);
    if (any(at.moves != 0.0)) distance_at(at.node_q, 2, &node);
    add_node_curvature(&at, node.bend, frame, weight, &sum);
  }
  for (int a = 0; a < 6; a++) for (int b = a; b < 6; b++) sum.upper[a][b][0] += h[a][b / BLOCK][b % BLOCK];
  finish_curvature(frame, &sum, out);
}
