/* An elastic foundation in cubic cells: the formulas of contact/cells/quadrature.py. */
/* Step from 0 to 1 over FADE, its slope and its bend */
INLINE double fade_of(double force, double *slope, double *bend) {
  const double x = force < FADE ? force / FADE : 1.0;
  *slope = 30.0 * x * x * (1.0 - x) * (1.0 - x) / FADE;
  *bend = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / (FADE * FADE);
  return x * x * x * (10.0 + x * (6.0 * x - 15.0));
}

/* The node within the rim that lies nearest to the body, or deepest in it */
FUNCTION int nearest_of(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  double least[MOST_BLOCKS + BLOCK], best = INFINITY;
  int nearest = 0, first_block = 0;
  Lanes found, points[3];
  s->searched = 0;
  for (int b = 0; b < p->block_count; b += BLOCK) {
    const Boxes *boxes = p->block_boxes + b / BOXES;
    for (int i = 0; i < 3; i++) points[i] = singles_at((const float *)(boxes->middle + i) + b % BOXES);
    distances(points, pose, frame, &found);
    found -= STEEPEST * singles_at((const float *)&boxes->size + b % BOXES);
    memcpy(least + b, &found, sizeof found);
    for (int l = 0; l < BLOCK && b + l < p->block_count; l++) {
      if (least[b + l] < least[first_block]) first_block = b + l;
    }
  }
  for (int k = -1; k < p->block_count; k++) {
    const int b = k < 0 ? first_block : k;
    if ((k >= 0 && b == first_block) || least[b] >= best) continue;
    begin_turn(s);
    s->nodes = 0;
    for (int c = BOXES * p->blocks[b].first; c < BOXES * p->blocks[b].last; c++) {
      if (p->cell_boxes[c / BOXES].size[c % BOXES] < 0.0) continue;
      s->nodes = take_slots(s, p->cells + c, s->nodes, s->corners[0]);
    }
    fill_up(s->ids, s->nodes);
    for (int i = 0; i < s->nodes; i += BLOCK) {
      places_of(p->nodes, s->ids + i, points);
      distances(points, pose, frame, &found);
      for (int l = 0; l < BLOCK; l++) {
        if (found[l] < best && p->known[s->ids[i + l]]) best = found[l], nearest = s->ids[i + l];
      }
    }
  }
  return nearest;
}

FUNCTION void gap_loads(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s, PatchLoads *out) {
  const int nearest = nearest_of(p, pose, frame, s);
  int ids[BLOCK];
  double by_twist[6];
  Lanes c[3], q[3], twist[6];
  Distance at;
  for (int l = 0; l < BLOCK; l++) ids[l] = nearest;
  places_of(p->nodes, ids, c);
  to_place(c, pose, frame, q);
  distance_at(q, order == SECOND ? 2 : 1, &at);
  out->gap = at.g[0];
  twist_of(at.slope, q, twist);
  for (int a = 0; a < 6; a++) by_twist[a] = -twist[a][0];
  to_fixed(frame, by_twist, out->gap_slope);
  if (order == SECOND) {
    const Lanes nothing[3] = {{0.0}}, one = {1.0}; /* of the lanes, which are all alike */
    Curvature sum;
    memset(&sum, 0, sizeof sum);
    for (int k = 0; k < 6; k++) at.bend[k] *= one;
    for (int k = 0; k < 3; k++) at.slope[k] *= one;
    add_curvature(q, at.bend, &at, nothing, at.slope, &sum);
    finish_curvature(frame, &sum, out->gap_curvature);
  }
}

/* Loads not yet faded, with order 2 their derivatives */
INLINE void contact_sums(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  if (!s->searched || order < s->filled || memcmp(s->pose, pose, sizeof s->pose)) {
    search(p, pose, frame, s);
    memcpy(s->pose, pose, sizeof s->pose);
    s->searched = 1, s->filled = 0;
  }
  if (s->filled == order) return;
  fill_nodes(p, pose, frame, order, s);
#if MOVING
  rub_nodes(p, frame, s);
#endif
  sum_cells(p, s, order, &s->sums);
  s->filled = order;
}

INLINE void loads_of_patch(int patch, const double *pose, const Frame *frame, int order, int with_gap,
                           const double *weights, PatchLoads *out) {
  const Patch *p = patches + patch;
  Scratch *s = own_scratch(patch);
  Sums *sums = &s->sums;
  double slope, bend, fade, by[7][6];
  memset(out, 0, sizeof *out);
  if (order != GAPS) contact_sums(p, pose, frame, order == VALUE ? 1 : 2, s);
  out->apart = order != GAPS && !(sums->loads[6] < 0.0);
  if (order == GAPS || out->apart) {
    if (with_gap) gap_loads(p, pose, frame, order, s, out);
    return;
  }
  out->cut = sums->cut;
  fade = fade_of(-sums->loads[6], &slope, &bend);
  for (int k = 0; k < 6; k++) out->wrench[k] = fade * sums->loads[k];
  if (order == VALUE) return;
  for (int k = 0; k < 7; k++) to_fixed(frame, (const double *)sums->by_twist[k], by[k]);
  for (int k = 0; k < 6; k++) {
    for (int a = 0; a < 6; a++) out->stiffness[k][a] = fade * by[k][a] - slope * sums->loads[k] * by[6][a];
  }
#if MOVING
  rub_sums(p, frame, s, order == SECOND ? weights : 0, out);
  for (int b = 0; b < LOCALS; b++) {
    double column[6], turned[6];
    for (int a = 0; a < 6; a++) column[a] = out->mixed[a][b], out->by_motion[a][b] = fade * column[a];
    to_fixed(frame, column, turned);
    for (int a = 0; a < 6; a++) out->mixed[a][b] = fade * turned[a] - slope * by[6][a] * out->gradient[b];
    out->gradient[b] *= fade;
    for (int c = 0; c < LOCALS; c++) out->local[b][c] *= fade;
  }
#endif
  if (order == SECOND) {
    double whole_weights[7], pull = 0.0, by_pull[6] = {0.0};
    for (int k = 0; k < 6; k++) {
      whole_weights[k] = fade * weights[k];
      pull += weights[k] * sums->loads[k];
      for (int a = 0; a < 6; a++) by_pull[a] += weights[k] * by[k][a];
    }
    whole_weights[6] = -slope * pull;
    contact_curvature(p, pose, frame, whole_weights, s, out->curvature);
    for (int a = 0; a < 6; a++) {
      for (int b = 0; b < 6; b++) {
        out->curvature[a][b] += bend * pull * by[6][a] * by[6][b] - slope * (by[6][a] * by_pull[b] + by_pull[a] * by[6][b]);
      }
    }
  }
}
