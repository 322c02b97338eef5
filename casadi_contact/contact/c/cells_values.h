/* Depths at the nodes of cells that may touch, and which of these cells they show to matter: a first evaluation of the
 * distance at the node, and where that calls for it a second one on the ray near the surface (see quadrature.py). */
/* Distances at all nodes found. Where they lie is worked out before: processors look ahead no farther than one block. */
FUNCTION void evaluate_nodes(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  KEEP_LOOP for (int k = 0; k < s->nodes; k += BLOCK) {
    Lanes c[3], q[3];
    places_of(p->nodes, s->ids + k, c);
    to_place(c, pose, frame, q);
    spot_of(q, s->spots + k / BLOCK);
  }
  KEEP_LOOP for (int k = 0; k < s->nodes; k += BLOCK) {
    Distance at;
    Lanes overlap;
    field_at(s->spots + k / BLOCK, 1, &at);
    overlap = -at.g;
    memcpy(s->overlap + k, &overlap, sizeof overlap);
    for (int i = 0; i < 3; i++) memcpy(s->node_slope[i] + k, at.slope + i, sizeof(Lanes));
  }
}

/* Of the points of BLOCK slots: -g and the gradient of g at their nodes */
INLINE Lanes node_overlaps(const Scratch *s, const int *slots) {
  Lanes overlap;
  for (int l = 0; l < BLOCK; l++) overlap[l] = s->overlap[slots[l]];
  return overlap;
}

INLINE void add_node_slopes(const Scratch *s, const int *slots, Depth *at) {
  for (int i = 0; i < 3; i++) for (int l = 0; l < BLOCK; l++) at->node_slope[i][l] = s->node_slope[i][slots[l]];
}

/* Values in BLOCK slots from the first, by the distances at their nodes; returns -g */
INLINE Lanes first_values(const Patch *p, int first, const Frame *frame, Scratch *s) {
  Four row[BLOCK];
  Lanes column[4];
  Depth at;
  column[3] = lanes_at(s->overlap + first);
  at.start = all(0.0), at.at.g = -column[3];
  for (int i = 0; i < 3; i++) at.at.slope[i] = lanes_at(s->node_slope[i] + first);
  surface_of(p->nodes, s->ids + first, &at);
  finish_depth(frame, &at);
  for (int i = 0; i < 3; i++) column[i] = at.value[i];
  to_rows(column, row);
  memcpy(s->value[first], row, sizeof row);
  return column[3];
}

/* Values in BLOCK slots by a second evaluation, with order 2 slopes by twist */
INLINE void evaluate_again(const Patch *p, const int *slots, const double *pose, const Frame *frame, int order,
                           Scratch *s) {
  int ids[BLOCK];
  Four row[BLOCK];
  Lanes column[4], slopes[3][6];
  Depth at;
  for (int l = 0; l < BLOCK; l++) ids[l] = s->ids[slots[l]];
  column[3] = node_overlaps(s, slots);
  depth_at(p->nodes, ids, column[3], pose, frame, order, &at);
  for (int i = 0; i < 3; i++) column[i] = at.value[i];
  to_rows(column, row);
  for (int l = 0; l < BLOCK; l++) memcpy(s->value[slots[l]], row + l, sizeof(Four));
  if (order < 2) return;
  add_node_slopes(s, slots, &at);
  value_slopes(&at, frame, slopes);
  for (int i = 0; i < 3; i++) {
    const Lanes rest[4] = {slopes[i][4], slopes[i][5], all(0.0), all(0.0)};
    Four others[BLOCK];
    to_rows(slopes[i], row);
    to_rows(rest, others);
    for (int l = 0; l < BLOCK; l++) {
      memcpy(s->slopes[slots[l]][i], row + l, sizeof(Four));
      memcpy(s->slopes[slots[l]][i] + 4, others + l, sizeof(Four));
    }
  }
}

/* Of the corners of BLOCK near cells: v their values, and -g at the nodes */
INLINE void corner_values(const Scratch *s, const int *chosen, Lanes v[12], Lanes overlaps[4]) {
  for (int c = 0; c < 4; c++) {
    Four row[BLOCK];
    Lanes column[4];
    for (int l = 0; l < BLOCK; l++) row[l] = four_at(s->value[s->corners[chosen[l]][c]]);
    to_columns(row, column);
    for (int i = 0; i < 3; i++) v[3 * c + i] = column[i];
    overlaps[c] = column[3];
  }
}

/* Bounds of the interpolated depth: the hull of Bezier points, corners' values and a third of their slopes on. */
INLINE void hull_of(const Lanes v[12], Lanes *lowest, Lanes *highest) {
  for (int c = 0; c < 4; c++) {
    const Lanes along_u = (c < 2 ? 1.0 : -1.0) / 3.0 * v[3 * c + 1];
    const Lanes along_v = (c % 2 ? -1.0 : 1.0) / 3.0 * v[3 * c + 2];
    const Lanes high = v[3 * c] + larger_of(along_u, all(0.0)) + larger_of(along_v, all(0.0));
    const Lanes low = v[3 * c] + smaller_of(along_u, all(0.0)) + smaller_of(along_v, all(0.0));
    *highest = c ? larger_of(*highest, high) : high, *lowest = c ? smaller_of(*lowest, low) : low;
  }
}

/* BLOCK near cells from the first, the last ones of them filled up; one bit for each that there is */
INLINE unsigned near_lanes(const Scratch *s, int first, int chosen[BLOCK]) {
  const unsigned there = lowest_bits(s->near - first);
  for (int l = 0; l < BLOCK; l++) chosen[l] = there >> l & 1 ? first + l : first;
  return there;
}

/* Keep those of the near cells whose interpolated depth, after one evaluation, may exceed -WIDTH by a second. Of their
 * corners those high above the body need one; deep ones are chosen already. What to do is found before it
 * is done: branches that are guessed wrong then cost little. */
FUNCTION void keep_cells(Scratch *s) {
  int kept = 0, again_count = s->again_count;
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    Lanes v[12], overlaps[4], lowest, highest, least;
    int chosen[BLOCK];
    const unsigned there = near_lanes(s, k, chosen);
    corner_values(s, chosen, v, overlaps);
    hull_of(v, &lowest, &highest);
    least = smaller_of(smaller_of(overlaps[0], overlaps[1]), smaller_of(overlaps[2], overlaps[3]));
    s->left[k / BLOCK] = there & bits_of(highest > -WIDTH - SPARE);
    s->some[k / BLOCK] = s->left[k / BLOCK] & bits_of(least < SMALL_DEPTH_WIDTH - SMALL_DEPTH);
  }
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    KEEP_LOOP for (unsigned high = s->some[k / BLOCK]; high; high &= high - 1) {
      const int *slots = s->corners[k + first_bit(high)];
      for (int c = 0; c < 4; c++) {
        const int slot = slots[c], wanted = s->value[slot][3] < SMALL_DEPTH_WIDTH - SMALL_DEPTH;
        s->again[again_count] = slot;
        again_count += wanted & (s->again_order[slot] != 1);
        s->again_order[slot] = 1;
      }
    }
  }
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    for (int l = 0; l < BLOCK; l++) {
      s->near_cells[kept] = s->near_cells[k + l];
      memmove(s->corners[kept], s->corners[k + l], sizeof s->corners[0]);
      kept += s->left[k / BLOCK] >> l & 1;
    }
  }
  s->near = kept, s->again_count = again_count;
}

/* Choose of the near cells those whose depth can exceed -WIDTH; first the `full` ones that exceed WIDTH everywhere. */
FUNCTION void sort_cells(const Patch *p, Scratch *s) {
  int cells = 0, full = 0;
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    Lanes v[12], overlaps[4], lowest, highest;
    int chosen[BLOCK];
    const unsigned there = near_lanes(s, k, chosen);
    corner_values(s, chosen, v, overlaps);
    hull_of(v, &lowest, &highest);
    s->some[k / BLOCK] = LOGARITHMIC ? 0 : bits_of(lowest > WIDTH);
    s->left[k / BLOCK] = there & bits_of(highest > -WIDTH);
  }
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    for (int l = 0; l < BLOCK; l++) {
      const int matters = s->left[k / BLOCK] >> l & 1, inside = matters & (s->some[k / BLOCK] >> l);
      const int is_full = inside & (p->cells[s->near_cells[k + l]].present == 0);
      s->chosen[cells] = s->chosen[full];
      s->chosen[is_full ? full : cells] = k + l;
      cells += matters, full += is_full;
    }
  }
  s->cells = cells, s->full = full;
}

/* Cells that may matter, after one evaluation at all their corners */
FUNCTION void search(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  int again_count = 0;
  find_cells(p, pose, frame, s);
  memset(s->again_order, 0, s->nodes * sizeof s->again_order[0]);
  evaluate_nodes(p, pose, frame, s);
  for (int k = 0; k < s->nodes; k += BLOCK) {
    const unsigned there = lowest_bits(s->nodes - k);
    const unsigned deep = there & bits_of(first_values(p, k, frame, s) > SMALL_DEPTH - SMALL_DEPTH_WIDTH);
    for (int l = 0; l < BLOCK; l++) s->again[again_count] = k + l, again_count += deep >> l & 1;
  }
  s->again_count = again_count;
  keep_cells(s);
}

/* A second evaluation at those corners of near cells that need it, or at all of them with their derivatives */
INLINE void fill_nodes(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  int again_count = order < 2 ? s->again_count : 0;
  for (int k = 0; k < s->near && order >= 2; k++) {
    for (int c = 0; c < 4; c++) {
      const int slot = s->corners[k][c];
      s->again[again_count] = slot;
      again_count += s->again_order[slot] != order;
      s->again_order[slot] = order;
    }
  }
  s->again_count = again_count;
  fill_up(s->again, s->again_count);
  for (int k = 0; k < s->again_count; k += BLOCK) evaluate_again(p, s->again + k, pose, frame, order, s);
  sort_cells(p, s);
}
