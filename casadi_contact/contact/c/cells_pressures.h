/* Pressure moments of a patch: the formulas of contact/cells/pressures.py. */
#define FULL_SHARE ((POWER + 2.0) / (POWER + 1.0))

/* x^(POWER - 1) */
INLINE Lanes high_power(Lanes x) {
  Lanes y = all(1.0);
  for (int k = 1; k < POWER; k++) y *= x;
  return y;
}

/* Area, sums of area s^POWER and of area s^(POWER + 1), s in thicknesses, and what each changes by in the corners' values */
typedef struct {
  Lanes sum[3], rate[3][12];
} Depths;

INLINE void add_depths(const Patch *p, const Scratch *s, const int *chosen, int count, Depths *of) {
  const Presence present = presence_of(p, s, chosen, count);
  Lanes v[12], unused[4], corner[4];
  corner_values(s, chosen, v, unused);
  for (int c = 0; c < 4; c++) {
    for (int l = 0; l < BLOCK; l++) corner[c][l] = p->nodes[s->ids[s->corners[chosen[l]][c]]].loads[6];
  }
  memset(of, 0, sizeof *of);
  KEEP_LOOP for (int r = 0; r < SUB_POINTS; r++) {
    Lanes slope, bend, third, area = all(0.0), by[3], high, x;
    x = positive_ramp(depth_of(v, r), WIDTH, &slope, &bend, &third) * (1.0 / THICKNESS);
    for (int c = 0; c < 4; c++) area += share[r][c] * corner[c];
    area *= present_at(&present, r);
    high = area * high_power(x);
    by[0] = area * bend, by[1] = POWER / THICKNESS * high * slope, by[2] = (POWER + 1.0) / THICKNESS * x * high * slope;
    of->sum[0] += area * slope, of->sum[1] += x * high, of->sum[2] += x * x * high;
    for (int k = 0; k < 3; k++) {
      for (int j = 0; j < 12; j++) of->rate[k][j] += by[k] * hermite[r][j];
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
    }
  }
}

FUNCTION void patch_moments(int patch, const double *pose, const Frame *frame, double value[6], double slope[6][6]) {
  const Patch *p = patches + patch;
  Scratch *s = own_scratch(patch);
  double depths[3] = {0.0}, by[6][8] = {{0.0}}, rates[3][8], by_force[6], fade, fade_slope, bend, force, mean;
  Lanes by_twist[3][PARTS];
  contact_sums(p, pose, frame, 2, s);
  force = -s->sums.loads[6];
  if (!(force > 0.0)) return;
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
  mean = depths[2] / depths[1];
  value[0] = depths[0], value[5] = FULL_SHARE * THICKNESS * mean;
  for (int a = 0; a < 6; a++) {
    by[0][a] = rates[0][a], by[5][a] = FULL_SHARE * THICKNESS / depths[1] * (rates[2][a] - mean * rates[1][a]);
  }
  fade = fade_of(force, &fade_slope, &bend);
  to_fixed(frame, by[1], by_force);
  for (int k = 0; k < 6; k++) {
    to_fixed(frame, by[k], slope[k]);
    for (int a = 0; a < 6; a++) slope[k][a] = fade * slope[k][a] + fade_slope * value[k] * by_force[a];
    value[k] *= fade;
  }
}
