/* Sums over the cells of a patch, whose pressures are shared out among the corners. */

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

/* Where the sub-points of one row along u lie between the corners along v: value and slope along u at both its ends, */
INLINE void row_of(const Lanes v[12], int q, Lanes row[4]) {
  const double *f = hermite_v[q];
  for (int a = 0; a < 2; a++, v += 6) {
    row[2 * a] = f[0] * v[0] + f[1] * v[2] + f[2] * v[3] + f[3] * v[5];
    row[2 * a + 1] = f[0] * v[1] + f[2] * v[4];
  }
}

/* and the value at one of them. */
INLINE Lanes depth_in_row(const Lanes row[4], int k) {
  const double *f = hermite_u[k];
  return f[0] * row[0] + f[1] * row[1] + (f[2] * row[2] + f[3] * row[3]);
}

/* The first `count` lanes: 1, the others 0. */
INLINE Lanes lanes_of(int count) {
  Lanes lives;
  for (int l = 0; l < BLOCK; l++) lives[l] = l < count;
  return lives;
}

/* Which of the sub-points of BLOCK cells lie on the surface; lives: which of the cells there are. */
typedef struct {
  const double *present[BLOCK];
  Lanes lives;
  int whole; /* all of them */
} Presence;

INLINE Presence presence_of(const Patch *p, const Scratch *s, const int *chosen, int count) {
  Presence of = {{0}, lanes_of(count), 1};
  for (int l = 0; l < BLOCK; l++) {
    const int present = p->cells[s->near_cells[chosen[l]]].present;
    of.present[l] = p->present[present], of.whole &= present == 0;
  }
  return of;
}

INLINE Lanes present_at(const Presence *of, int r) {
  Lanes w = of->lives;
  if (of->whole) return w;
  for (int l = 0; l < BLOCK; l++) w[l] *= of->present[l][r];
  return w;
}

/* + derivatives of the weights at one row along u, from its sums over u with the products of share and hermite: the sums
 * over both directions are taken one after the other. */
INLINE void add_rates(const Lanes sums[8], const double products[8], Lanes rate[4][12]) {
  for (int a = 0; a < 2; a++) {
    for (int b = 0; b < 2; b++) {
      for (int corner = 0; corner < 4; corner++) {
        const Lanes *along_u = sums + 4 * a + corner / 2 * 2;
        const double *along_v = products + 4 * b + corner % 2 * 2;
        Lanes *of = rate[2 * a + b] + 3 * corner;
        of[0] += along_u[0] * along_v[0], of[1] += along_u[1] * along_v[0], of[2] += along_u[0] * along_v[1];
      }
    }
  }
}

/* Weights of BLOCK cells' corners, and with order 2 their derivatives by the corners' values */
FUNCTION void cell_weights(const Patch *p, const Scratch *s, const int *chosen, int count, int full, int order,
                           Lanes weight[4], Lanes rate[4][12], int *cut) {
  const Presence present = presence_of(p, s, chosen, count);
  const Lanes lives = present.lives;
  Lanes v[12], unused[4], deepest = all(0.0);
  corner_values(s, chosen, v, unused);
  for (int c = 0; c < 4; c++) {
    weight[c] = all(0.0);
    for (int j = 0; j < 12; j++) {
      if (full) weight[c] += whole[c][j] * v[j];
      if (order >= 2) rate[c][j] = full ? whole[c][j] * lives : all(0.0);
    }
    weight[c] *= lives;
  }
  for (int q = 0; q < ALONG_V && !full; q++) {
    Lanes sums[8], row[4], forces[2] = {{0.0}};
    for (int i = 0; i < 8; i++) sums[i] = all(0.0);
    row_of(v, q, row);
    KEEP_LOOP for (int k = 0; k < ALONG_U; k++) {
      const int r = k * ALONG_V + q;
      const Lanes here = present_at(&present, r);
      Lanes slope, bend, stiffness, ignored, force;
      const Lanes depth = ramp(depth_in_row(row, k), &slope, &bend);
      force = here * soft_pressure(depth, &stiffness, &ignored);
      stiffness *= here * slope;
      for (int a = 0; a < 2; a++) forces[a] += share_u[k][a] * force;
      for (int i = 0; i < 8 && order >= 2; i++) sums[i] += product_u[k][i] * stiffness;
      deepest = larger_of(deepest, here * depth);
    }
    for (int c = 0; c < 4; c++) weight[c] += share_v[q][c % 2] * forces[c / 2];
    if (order >= 2) add_rates(sums, product_v[q], rate);
  }
  for (int l = 0; l < count; l++) *cut |= p->cells[s->near_cells[chosen[l]]].rim && (full || deepest[l] > 0.0);
}

#if MOVING
typedef double Load;
#define LOADS_AT(p, s, slot) (s)->rubbed[slot]
#define CORNER_LOADS(p, s, near, c) LOADS_AT(p, s, (s)->corners[near][c])
#define PART_OF(loads) lanes_at(loads)

/* What of the loads of BLOCK nodes depends on the motion; these loads at rest */
INLINE void slip_of(const Patch *p, const int *ids, const Frame *frame, Lanes c[3], Lanes load[8], Slip *slip) {
  const float *row[2][BLOCK];
  Depth at;
  for (int l = 0; l < BLOCK; l++) row[0][l] = p->nodes[ids[l]].loads, row[1][l] = row[0][l] + 4;
  singles_to_columns(row[0], load), singles_to_columns(row[1], load + 4);
  places_of(p->nodes, ids, c);
  surface_of(p->nodes, ids, &at);
  slip_at(frame->motion, c, at.n, load[6], slip);
}

FUNCTION void rub_nodes(const Patch *p, const Frame *frame, Scratch *s) {
  KEEP_LOOP for (int k = 0; k < s->nodes; k += BLOCK) {
    Lanes c[3], load[8];
    Four row[2][BLOCK];
    Slip slip;
    slip_of(p, s->ids + k, frame, c, load, &slip);
    rub(&slip, load);
    to_rows(load, row[0]), to_rows(load + 4, row[1]);
    for (int l = 0; l < 2 * BLOCK; l++) memcpy(s->rubbed[k + l / 2] + l % 2 * 4, row[l % 2] + l / 2, sizeof(Four));
  }
}

/* Forces of BLOCK nodes, [6], and their derivatives by twist in the axes of the moving body; zero beyond the last node */
INLINE void forces_of(const Scratch *s, int first, Lanes force[8]) {
  const Lanes there = lanes_of(s->nodes - first);
  Four row[2][BLOCK];
  for (int l = 0; l < BLOCK; l++) for (int h = 0; h < 2; h++) row[h][l] = four_at(s->share[first + l] + 4 * h);
  to_columns(row[0], force), to_columns(row[1], force + 4);
  for (int k = 0; k < 8; k++) force[k] = pick(there > 0.0, -force[k], all(0.0));
}

/* Derivatives by the motion, not yet faded: of loads, or of weighted ones with second derivatives, in body axes */
FUNCTION void rub_sums(const Patch *p, const Frame *frame, const Scratch *s, const double *weights, PatchLoads *out) {
  Lanes local[LOCALS][LOCALS] = {{{0.0}}}, gradient[LOCALS] = {{0.0}}, mixed[6][LOCALS] = {{{0.0}}};
  KEEP_LOOP for (int k = 0; k < s->nodes; k += BLOCK) {
    Lanes c[3], load[8], force[8], by[LOCALS], rest = all(0.0);
    Slip slip;
    Pull of;
    slip_of(p, s->ids + k, frame, c, load, &slip);
    forces_of(s, k, force);
    if (!weights) {
      add_rub_slopes(&slip, frame->motion, c, load, force[6], mixed);
      continue;
    }
    for (int i = 0; i < 6; i++) rest += weights[i] * load[i];
    pull_of(&slip, frame->motion, c, weights, rest, &of, by);
    add_rub_curvature(&slip, frame->motion, c, &of, force[6], local);
    for (int b = 0; b < LOCALS; b++) {
      gradient[b] += force[6] * by[b];
      for (int a = 0; a < 6; a++) mixed[a][b] += force[a] * by[b];
    }
  }
  for (int b = 0; b < LOCALS; b++) {
    out->gradient[b] = sum_of(gradient[b]);
    for (int a = 0; a < 6; a++) out->mixed[a][b] = sum_of(mixed[a][b]);
    for (int d = b; d < LOCALS; d++) out->local[b][d] = out->local[d][b] = sum_of(local[b][d]);
  }
}
#else
typedef float Load;
#define LOADS_AT(p, s, slot) (p)->nodes[(s)->ids[slot]].loads
#define CORNER_LOADS(p, s, near, c) (p)->nodes[(p)->cells[(s)->near_cells[near]].corners[c]].loads
#define PART_OF(loads) singles_at(loads)
#endif

/* The loads of one cell's corners by their weights, */
INLINE void add_loads(const Load *const of[4], int lane, const Lanes weight[4], Lanes loads[4][PARTS]) {
  for (int c = 0; c < 4; c++) {
    for (int h = 0; h < PARTS; h++) loads[c][h] -= weight[c][lane] * PART_OF(of[c] + h * BLOCK);
  }
}

/* and in slots the derivatives by twist of the weights, these behind them: in one store, as vectors are read again */
INLINE void add_slopes(Scratch *s, const int at[4], int lane, const Lanes weight[4], const Lanes rate[4][12]) {
  Lanes behind = {0.0};
  behind[6 % BLOCK] = 1.0;
  for (int h = 0; h < PARTS; h++) {
    Lanes sum[4];
    for (int c = 0; c < 4; c++) sum[c] = lanes_at(s->share[at[c]] + h * BLOCK);
    for (int c = 0; c < 4 && h == 6 / BLOCK; c++) sum[c] += weight[c][lane] * behind;
    for (int j = 0; j < 12; j++) {
      const Lanes slopes = lanes_at(s->slopes[at[j / 3]][j % 3] + h * BLOCK);
      for (int c = 0; c < 4; c++) sum[c] += rate[c][j][lane] * slopes;
    }
    for (int c = 0; c < 4; c++) memcpy(s->share[at[c]] + h * BLOCK, sum + c, sizeof(Lanes));
  }
}

INLINE void sum_cells(const Patch *p, Scratch *s, int order, Sums *sums) {
  Lanes loads[4][PARTS];
  memset(loads, 0, sizeof loads);
  memset(sums, 0, sizeof *sums);
  if (order >= 2) memset(s->share, 0, s->nodes * sizeof s->share[0]);
  for (int first = 0, end = s->full; first < s->cells; first = end < first + BLOCK ? end : first + BLOCK) {
    const int is_full = first < s->full, count = (is_full ? s->full : s->cells) - first;
    Lanes weight[4], rate[4][12];
    int chosen[BLOCK];
    end = is_full ? s->full : s->cells;
    for (int l = 0; l < BLOCK; l++) chosen[l] = s->chosen[l < count ? first + l : first];
    cell_weights(p, s, chosen, count < BLOCK ? count : BLOCK, is_full, order, weight, rate, &sums->cut);
    KEEP_LOOP for (int l = 0; l < (count < BLOCK ? count : BLOCK); l++) {
      const Load *of[4];
      for (int c = 0; c < 4; c++) of[c] = CORNER_LOADS(p, s, chosen[l], c);
      add_loads(of, l, weight, loads);
      if (order >= 2) add_slopes(s, s->corners[chosen[l]], l, weight, rate);
    }
  }
  for (int h = 0; h < PARTS; h++) loads[0][h] = (loads[0][h] + loads[1][h]) + (loads[2][h] + loads[3][h]);
  memcpy(sums->loads, loads, sizeof sums->loads);
  for (int k = 0; k < s->nodes && order >= 2; k++) {
    const Load *of = LOADS_AT(p, s, k);
    for (int h = 0; h < PARTS; h++) {
      const Lanes part = lanes_at(s->share[k] + h * BLOCK);
      for (int i = 0; i < 7; i++) sums->by_twist[i][h] -= of[i] * part;
    }
  }
}
