/* Pressure moments of a patch: the formulas of contact/cells/quadrature.py. */
#define FULL_SHARE ((POWER + 2.0) / (POWER + 1.0))

/* x^(POWER - 1) */
INLINE Lanes high_power(Lanes x) {
  Lanes y = all(1.0);
  for (int k = 1; k < POWER; k++) y *= x;
  return y;
}

/* Of nodes, by slot: derivatives by twist, axes of the moving body, of the share at [SHARE] */
#define SHARE 6
static __thread double facing[MOST_NODES + BLOCK][8] __attribute__((aligned(64)));

/* Share of a node's depth that may be the largest, and its slope: see quadrature.py */
INLINE Lanes facing_share(Lanes sigma, Lanes *slope) {
  const Lanes x = smaller_of(larger_of((sigma - STEEP_RAY) * (1.0 / STEEP_RAY_WIDTH), all(0.0)), all(1.0));
  *slope = (1.0 - FLATTEST) * 30.0 / STEEP_RAY_WIDTH * x * x * (1.0 - x) * (1.0 - x);
  return FLATTEST + (1.0 - FLATTEST) * x * x * x * (10.0 + x * (6.0 * x - 15.0));
}

/* The shares of all corners that `fill_nodes` evaluated again */
FUNCTION void fill_facing(const Patch *p, const double *pose, const Frame *frame, const Scratch *s) {
  KEEP_LOOP for (int k = 0; k < s->again_count; k += BLOCK) {
    const int *slots = s->again + k;
    const Lanes overlap = node_overlaps(s, slots);
    int ids[BLOCK];
    Lanes share, slope, rate[6];
    Depth at;
    for (int l = 0; l < BLOCK; l++) ids[l] = s->ids[slots[l]];
    depth_at(p->nodes, ids, overlap, pose, frame, 1, &at);
    share = facing_share(at.sigma, &slope);
    for (int a = 0; a < 6; a++) rate[a] = all(0.0);
    if (any(slope != 0.0)) {
      DepthSlopes by;
      depth_at(p->nodes, ids, overlap, pose, frame, 2, &at);
      add_node_slopes(s, slots, &at);
      slopes_of_depth(&at, frame, &by);
      for (int a = 0; a < 6; a++) rate[a] = slope * by.sigma[a];
    }
    for (int l = 0; l < BLOCK; l++) {
      double *of = facing[s->again[k + l]];
      for (int a = 0; a < 6; a++) of[a] = rate[a][l];
      of[SHARE] = share[l];
    }
  }
}

/* Area, sums of area s^POWER and of area s^(POWER + 1), s in thicknesses, and what each changes by in the corners'
 * values; the latter two also by the corners' shares */
typedef struct {
  Lanes sum[3], rate[3][12], by_share[3][4];
} Depths;

INLINE void add_depths(const Patch *p, const Scratch *s, const int *chosen, int count, Depths *of) {
  const Presence present = presence_of(p, s, chosen, count);
  Lanes v[12], faced[12], unused[4], corner[4], share_of[4];
  corner_values(s, chosen, v, unused);
  for (int c = 0; c < 4; c++) {
    for (int l = 0; l < BLOCK; l++) {
      const int slot = s->corners[chosen[l]][c];
      corner[c][l] = p->nodes[s->ids[slot]].loads[6], share_of[c][l] = facing[slot][SHARE];
    }
    for (int i = 3 * c; i < 3 * c + 3; i++) faced[i] = share_of[c] * v[i];
  }
  memset(of, 0, sizeof *of);
  KEEP_LOOP for (int r = 0; r < SUB_POINTS; r++) {
    Lanes slope, bend, third, area = all(0.0), by[3], high, x;
    for (int c = 0; c < 4; c++) area += share[r][c] * corner[c];
    area *= present_at(&present, r);
    positive_ramp(depth_of(v, r), WIDTH, &slope, &bend, &third);
    of->sum[0] += area * slope, by[0] = area * bend;
    x = positive_ramp(depth_of(faced, r), WIDTH, &slope, &bend, &third) * (1.0 / THICKNESS);
    high = area * high_power(x);
    by[1] = POWER / THICKNESS * high * slope, by[2] = (POWER + 1.0) / THICKNESS * x * high * slope;
    of->sum[1] += x * high, of->sum[2] += x * x * high;
    for (int k = 0; k < 3; k++) for (int j = 0; j < 12; j++) of->rate[k][j] += by[k] * hermite[r][j];
  }
  for (int k = 1; k < 3; k++) {
    for (int j = 0; j < 12; j++) {
      of->by_share[k][j / 3] += of->rate[k][j] * v[j];
      of->rate[k][j] *= share_of[j / 3];
    }
  }
}

/* The three sums of `Depths` and their derivatives by twist in the axes of the moving body */
INLINE void sum_depths(const Patch *p, const Scratch *s, double value[3], Lanes by_twist[3][PARTS]) {
  memset(by_twist, 0, sizeof(Lanes[3][PARTS]));
  for (int first = 0; first < s->cells; first += BLOCK) {
    const int count = s->cells - first < BLOCK ? s->cells - first : BLOCK;
    int chosen[BLOCK];
    Depths of;
    for (int l = 0; l < BLOCK; l++) chosen[l] = s->chosen[l < count ? first + l : first];
    add_depths(p, s, chosen, count, &of);
    for (int k = 0; k < 3; k++) value[k] += sum_of(of.sum[k]);
    KEEP_LOOP for (int l = 0; l < count; l++) {
      for (int j = 0; j < 12; j++) {
        const double *slopes = s->slopes[s->corners[chosen[l]][j / 3]][j % 3];
        for (int k = 0; k < 3; k++) {
          for (int h = 0; h < PARTS; h++) by_twist[k][h] += of.rate[k][j][l] * lanes_at(slopes + h * BLOCK);
        }
      }
      for (int c = 0; c < 4; c++) {
        const double *slopes = facing[s->corners[chosen[l]][c]];
        for (int k = 1; k < 3; k++) {
          for (int h = 0; h < PARTS; h++) by_twist[k][h] += of.by_share[k][c][l] * lanes_at(slopes + h * BLOCK);
        }
      }
    }
  }
}

FUNCTION void patch_moments(int patch, const double *pose, const Frame *frame, double value[6], double slope[6][6]) {
  const Patch *p = patches + patch;
  Scratch *s = own_scratch(patch);
  double depths[3] = {0.0}, by[6][8] = {{0.0}}, rates[3][8], by_force[6], fade, fade_slope, bend, force, mean, peak;
  Lanes by_twist[3][PARTS];
  contact_sums(p, pose, frame, 2, s);
  force = -s->sums.loads[6];
  if (!(force > 0.0)) return;
  fill_facing(p, pose, frame, s);
  sum_depths(p, s, depths, by_twist);
  memcpy(rates, by_twist, sizeof rates);
  for (int k = 0; k < s->nodes; k++) {
    const Node *node = p->nodes + s->ids[k];
    for (int i = 0; i < 4; i++) {
      const double weight = node->loads[6] * (i ? node->c[i - 1] : 1.0);
      value[1 + i] += weight * s->share[k][6];
      for (int a = 0; a < 6; a++) by[1 + i][a] += weight * s->share[k][a];
    }
  }
  peak = depths[1] > 0.0 ? FULL_SHARE * THICKNESS / depths[1] : 0.0;
  mean = depths[1] > 0.0 ? depths[2] / depths[1] : 0.0;
  value[0] = depths[0], value[5] = FULL_SHARE * THICKNESS * mean;
  for (int a = 0; a < 6; a++) by[0][a] = rates[0][a], by[5][a] = peak * (rates[2][a] - mean * rates[1][a]);
  fade = fade_of(force, &fade_slope, &bend);
  to_fixed(frame, by[1], by_force);
  for (int k = 0; k < 6; k++) {
    to_fixed(frame, by[k], slope[k]);
    for (int a = 0; a < 6; a++) slope[k][a] = fade * slope[k][a] + fade_slope * value[k] * by_force[a];
    value[k] *= fade;
  }
}
