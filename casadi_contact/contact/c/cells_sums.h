/* Sums over the cells of a patch: of its pressures, shared out among the corners, with derivatives by twist in the axes
 * of the moving body. The loads of a node are those of `Node`: force, moment, area. */
typedef struct {
  double loads[7];
  Lanes by_twist[7][2]; /* six of the eight numbers */
  int cut;
} Sums;

/* Value at the sub-points, of the functions hermite[r][j], and its share of the corners, share[r][c]: see basis.py */
INLINE Lanes ramp(Lanes x, Lanes *slope, Lanes *bend) {
  const Lanes u = smaller_of(larger_of(x * (1.0 / WIDTH), all(-1.0)), all(1.0)), u2 = u * u;
  const Lanes within = 0.5 * u + 15.0 / 32.0 * u2 * (1.5 - 5.0 / 6.0 * u2 + 7.0 / 30.0 * u2 * u2) + 5.0 / 64.0;
  *slope = 0.5 + 15.0 / 32.0 * u * (3.0 - 10.0 / 3.0 * u2 + 1.4 * u2 * u2);
  *bend = 15.0 / (32.0 * WIDTH) * (1.0 - u2) * (3.0 - 7.0 * u2);
  return pick(x > WIDTH, x, WIDTH * within); /* 0 at u = -1 */
}

/* Pressure at a depth that the ramp may have put a little below zero: continued by its derivatives at zero */
#if LOGARITHMIC
#define BEND_AT_ZERO (MODULUS / (THICKNESS * THICKNESS))
#else
#define BEND_AT_ZERO 0.0
#endif
INLINE Lanes soft_pressure(Lanes depth, Lanes *slope, Lanes *bend) {
  const Lanes below = smaller_of(depth, all(0.0));
  const Mask under = depth <= 0.0;
  *slope = pick(under, STIFFNESS_AT_ZERO + BEND_AT_ZERO * below, pressure_slope_at(depth));
  *bend = pick(under, all(BEND_AT_ZERO), pressure_bend_at(depth));
  return pressure_at(depth) + (STIFFNESS_AT_ZERO + 0.5 * BEND_AT_ZERO * below) * below;
}

INLINE Lanes depth_of(const Lanes v[12], int r) {
  Lanes a = hermite[r][0] * v[0], b = hermite[r][1] * v[1], c = hermite[r][2] * v[2];
  for (int j = 3; j < 12; j += 3) a += hermite[r][j] * v[j], b += hermite[r][j + 1] * v[j + 1], c += hermite[r][j + 2] * v[j + 2];
  return a + (b + c);
}

INLINE Lanes present_of(const Patch *p, const int *chosen, int count, int r) {
  Lanes w = all(0.0);
  for (int l = 0; l < count; l++) w[l] = p->present[p->cells[chosen[l]].present][r];
  return w;
}

/* Weights of four cells' corners, and with order 2 their derivatives by the corners' values */
FUNCTION void cell_weights(const Patch *p, const Scratch *s, const int *chosen, int count, int full, int order,
                         Lanes weight[4], Lanes rate[4][12], int *cut) {
  Lanes v[12];
  corner_values(p, s, chosen, v);
  if (full) {
    const Lanes lives = {1.0, count > 1, count > 2, count > 3};
    for (int c = 0; c < 4; c++) {
      weight[c] = all(0.0);
      for (int j = 0; j < 12; j++) {
        weight[c] += whole[c][j] * v[j];
        if (order >= 2) rate[c][j] = whole[c][j] * lives;
      }
      weight[c] *= lives;
    }
    return;
  }
  for (int c = 0; c < 4; c++) {
    weight[c] = all(0.0);
    for (int j = 0; j < 12 && order >= 2; j++) rate[c][j] = all(0.0);
  }
  for (int r = 0; r < SUB_POINTS; r++) {
    const Lanes here = present_of(p, chosen, count, r);
    Lanes slope, bend, stiffness, unused, force;
    const Lanes depth = ramp(depth_of(v, r), &slope, &bend);
    force = here * soft_pressure(depth, &stiffness, &unused);
    stiffness *= here * slope;
    for (int c = 0; c < 4; c++) {
      weight[c] += share[r][c] * force;
      if (order >= 2) {
        const Lanes part = share[r][c] * stiffness;
        for (int j = 0; j < 12; j++) rate[c][j] += hermite[r][j] * part;
      }
    }
    for (int l = 0; l < count; l++) *cut |= p->cells[chosen[l]].rim && depth[l] > 0.0 && here[l] > 0.0;
  }
}

/* In slots: the weights of the nodes' loads, their derivatives by twist before them */
INLINE void add_weights(const Patch *p, Scratch *s, int chosen, int lane, int order, const Lanes weight[4],
                        const Lanes rate[4][12]) {
  const Cell *cell = p->cells + chosen;
  int slots[4];
  for (int c = 0; c < 4; c++) slots[c] = s->slot[cell->corners[c]], s->share[slots[c]][6] += weight[c][lane];
  if (order < 2) return;
  for (int c = 0; c < 4; c++) {
    Lanes first = all(0.0), second = all(0.0);
    for (int j = 0; j < 12; j++) {
      const double *slopes = s->slopes[slots[j / 3]][j % 3];
      first += rate[c][j][lane] * lanes_at(slopes), second += rate[c][j][lane] * lanes_at(slopes + BLOCK);
    }
    first += lanes_at(s->share[slots[c]]), second += lanes_at(s->share[slots[c]] + BLOCK);
    memcpy(s->share[slots[c]], &first, sizeof first), memcpy(s->share[slots[c]] + BLOCK, &second, sizeof second);
  }
}

INLINE void sum_cells(const Patch *p, Scratch *s, int order, Sums *sums) {
  Lanes loads[2] = {all(0.0), all(0.0)};
  memset(sums, 0, sizeof *sums);
  memset(s->share, 0, s->nodes * sizeof s->share[0]);
  for (int first = 0, end = s->full; first < s->cells; first = end < first + BLOCK ? end : first + BLOCK) {
    const int is_full = first < s->full, count = (is_full ? s->full : s->cells) - first;
    Lanes weight[4], rate[4][12];
    int chosen[BLOCK];
    end = is_full ? s->full : s->cells;
    for (int l = 0; l < BLOCK; l++) chosen[l] = s->chosen[l < count ? first + l : first];
    cell_weights(p, s, chosen, count < BLOCK ? count : BLOCK, is_full, order, weight, rate, &sums->cut);
    KEEP_LOOP for (int l = 0; l < (count < BLOCK ? count : BLOCK); l++) {
      add_weights(p, s, chosen[l], l, order, weight, rate);
      if (is_full) sums->cut |= p->cells[chosen[l]].rim;
    }
  }
  for (int k = 0; k < s->nodes; k++) {
    const double *of = p->nodes[s->ids[k]].loads;
    const Lanes first = lanes_at(s->share[k]), second = lanes_at(s->share[k] + BLOCK);
    if (s->share[k][6] == 0.0) continue;
    loads[0] -= s->share[k][6] * lanes_at(of), loads[1] -= s->share[k][6] * lanes_at(of + BLOCK);
    for (int i = 0; i < 7 && order >= 2; i++) sums->by_twist[i][0] -= of[i] * first, sums->by_twist[i][1] -= of[i] * second;
  }
  for (int i = 0; i < 7; i++) sums->loads[i] = loads[i / BLOCK][i % BLOCK];
}
