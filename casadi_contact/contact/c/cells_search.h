/* The cells of a patch that may touch in a pose, and what their corners are like. */
typedef struct {
  int corners[4], present, rim;
} Cell;

typedef struct {
  int first, last; /* of its boxes of cells */
} Block;

typedef struct {
  const Node *nodes;
  const Cell *cells;        /* as many as there are in boxes: none where these are none */
  const Boxes *cell_boxes;  /* around their surface, sub-points and all */
  const Boxes *block_boxes; /* around the surface of blocks */
  const Block *blocks;
  const unsigned char *known;          /* nodes within the rim */
  const double (*present)[SUB_POINTS]; /* share of the surface at sub-points: of whole cells, then of others */
  int block_count;
} Patch;

/* Loads of a patch, not yet faded, as those of `Node` (force, moment, area), and their derivatives by twist in the axes
 * of the moving body */
#define PARTS (8 / BLOCK)
typedef struct {
  double loads[8];
  Lanes by_twist[7][PARTS]; /* six of the eight numbers */
  int cut;
} Sums;

/* Of a patch in one pose; one for each thread, since it would not fit on every stack. Kept: an optimiser asks for
 * value, Jacobian and Hessian in one pose after the other. What is found does not depend on what was asked before. */
typedef struct {
  double pose[6]; /* in which cells were chosen, where `searched`; `filled`: the order of what nodes and sums hold */
  int searched, filled;
  int nodes, ids[MOST_NODES + BLOCK]; /* looked at: a slot each in what follows */
  unsigned mark[MOST_NODES], turn;    /* of a node: turn and slot; below the present turn before that */
  int groups[MOST_GROUPS];
  unsigned touched[MOST_GROUPS + MOST_BLOCKS];
  int near, near_cells[MOST_CELLS + BLOCK]; /* cells that may touch, */
  int corners[MOST_CELLS + BLOCK][4];          /* the slots of their corners, */
  int cells, full, chosen[MOST_CELLS + BLOCK]; /* and which of these cells matter */
  int agains, again[MOST_NODES + BLOCK]; /* slots that are worth a second look, */
  int is_again[MOST_NODES];              /* and of which order they had one */
  Sums sums;
  double value[MOST_NODES + BLOCK][4] __attribute__((aligned(64))); /* three, and -g at the node */
  double node_slope[3][MOST_NODES + BLOCK] __attribute__((aligned(64))); /* gradient of g at the node */
  double weight[MOST_NODES + BLOCK][4];
  double slopes[MOST_NODES + BLOCK][3][8], share[MOST_NODES + BLOCK][8];
} Scratch;
static __thread Scratch scratch[PATCHES] __attribute__((aligned(64)));

INLINE Scratch *own_scratch(int patch) {
  Scratch *s = scratch + patch;
  __asm__("" : "+r"(s)); /* else the thread's address is asked for at each use */
  return s;
}

/* Distance at BLOCK points of the fixed frame */
FUNCTION void distances(const Lanes points[3], const double *pose, const Frame *frame, Lanes *found) {
  Lanes q[3];
  Distance at;
  to_place(points, pose, frame, q);
  distance_at(q, 1, &at);
  *found = at.g;
}

INLINE void begin_turn(Scratch *s) {
  if (s->turn >= UINT_MAX - 2 * MOST_NODES) memset(s->mark, 0, sizeof s->mark), s->turn = 0;
  s->turn += MOST_NODES;
}

/* Filled up with the last one, to whole lanes */
INLINE void fill_up(int *ids, int count) {
  for (int k = count; k % BLOCK; k++) ids[k] = ids[count - 1];
}

/* Slots of a cell's corners, new ones for those that were not seen this turn; how many slots are then taken. Without
 * branches, which would be guessed wrong. */
INLINE int take_slots(Scratch *s, const Cell *cell, int taken, int slots[4]) {
  const unsigned turn = s->turn;
  for (int k = 0; k < 4; k++) {
    const int node = cell->corners[k];
    const unsigned mark = s->mark[node], fresh = mark < turn, now = fresh ? turn + (unsigned)taken : mark;
    s->ids[taken] = node, s->mark[node] = now, slots[k] = (int)(now - turn);
    taken += (int)fresh;
  }
  return taken;
}

/* Fill `near_cells` with the cells that may touch, and `ids` and `corners` with their corners. */
FUNCTION void find_cells(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  const Place place = place_of(pose, frame);
  int groups = 0, near = 0, nodes = 0;
  begin_turn(s);
  KEEP_LOOP for (int b = 0; b < p->block_count; b += BOXES) {
    s->touched[b / BOXES] = may_touch(p->block_boxes + b / BOXES, pose, frame, &place);
  }
  KEEP_LOOP for (int b = 0; b < p->block_count; b += BOXES) {
    KEEP_LOOP for (unsigned left = s->touched[b / BOXES]; left; left &= left - 1) {
      const Block *block = p->blocks + b + first_bit(left);
      for (int k = block->first; k < block->last; k++) s->groups[groups++] = k;
    }
  }
  KEEP_LOOP for (int g = 0; g < groups; g++) {
    s->touched[g] = may_touch(p->cell_boxes + s->groups[g], pose, frame, &place);
  }
  KEEP_LOOP for (int g = 0; g < groups; g++) {
    KEEP_LOOP for (unsigned left = s->touched[g]; left; left &= left - 1) {
      const int cell = BOXES * s->groups[g] + first_bit(left);
      nodes = take_slots(s, p->cells + cell, nodes, s->corners[near]);
      s->near_cells[near++] = cell;
    }
  }
  s->near = near, s->nodes = nodes;
  fill_up(s->ids, nodes);
}

/* Of the points of BLOCK slots: -g and the gradient of g at their nodes, after a first look */
INLINE Lanes node_overlaps(const Scratch *s, const int *slots) {
  Lanes overlap;
  for (int l = 0; l < BLOCK; l++) overlap[l] = s->value[slots[l]][3];
  return overlap;
}

INLINE void add_node_slopes(const Scratch *s, const int *slots, Depth *at) {
  for (int i = 0; i < 3; i++) {
    for (int l = 0; l < BLOCK; l++) at->node_slope[i][l] = s->node_slope[i][slots[l]];
  }
}

/* Values in BLOCK slots, with order 2 slopes by twist; overlap: -g at the nodes themselves, 0 at the first look, which
 * is at slots in turn and returns it. */
INLINE Lanes fill_slots(const Patch *p, const int *slots, const Lanes *overlap, const double *pose, const Frame *frame,
                        int order, Scratch *s) {
  int ids[BLOCK];
  Four row[BLOCK];
  Lanes column[4], slopes[3][6];
  Depth at;
  for (int l = 0; l < BLOCK; l++) ids[l] = s->ids[slots[l]];
  depth_at(p->nodes, ids, overlap, pose, frame, order, &at);
  for (int i = 0; i < 3; i++) column[i] = at.value[i];
  column[3] = overlap ? *overlap : -at.at.g;
  for (int i = 0; i < 3 && !overlap; i++) memcpy(s->node_slope[i] + slots[0], at.at.slope + i, sizeof(Lanes));
  to_rows(column, row);
  for (int l = 0; l < BLOCK; l++) memcpy(s->value[slots[l]], row + l, sizeof(Four));
  if (order < 2) return column[3];
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
  return column[3];
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

/* Bounds of the interpolated depth: a cubic lies within the hull of its Bezier points, the corners' values and a third
 * of their slopes further in. */
INLINE void hull_of(const Lanes v[12], Lanes *lowest, Lanes *highest) {
  for (int c = 0; c < 4; c++) {
    const Lanes along_u = (c < 2 ? 1.0 : -1.0) / 3.0 * v[3 * c + 1];
    const Lanes along_v = (c % 2 ? -1.0 : 1.0) / 3.0 * v[3 * c + 2];
    const Lanes high = v[3 * c] + larger_of(along_u, all(0.0)) + larger_of(along_v, all(0.0));
    const Lanes low = v[3 * c] + smaller_of(along_u, all(0.0)) + smaller_of(along_v, all(0.0));
    *highest = c ? larger_of(*highest, high) : high, *lowest = c ? smaller_of(*lowest, low) : low;
  }
}

/* Keep those of the near cells whose interpolated depth, after one look, may exceed -WIDTH by a second. Of their
 * corners those that lie high above the body are worth one; deep ones are known already. */
FUNCTION void keep_cells(Scratch *s) {
  int kept = 0, agains = s->agains;
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    const unsigned there = lowest_bits(s->near - k);
    Lanes v[12], overlaps[4], lowest, highest, least;
    int some[BLOCK];
    unsigned left, high;
    for (int l = 0; l < BLOCK; l++) some[l] = there >> l & 1 ? k + l : k;
    corner_values(s, some, v, overlaps);
    hull_of(v, &lowest, &highest);
    least = smaller_of(smaller_of(overlaps[0], overlaps[1]), smaller_of(overlaps[2], overlaps[3]));
    left = there & bits_of(highest > -WIDTH - SPARE);
    high = left & bits_of(least < SMALL_DEPTH_WIDTH - SMALL_DEPTH);
    KEEP_LOOP for (; high; high &= high - 1) {
      const int *slots = s->corners[k + first_bit(high)];
      for (int c = 0; c < 4; c++) {
        const int slot = slots[c], wanted = s->value[slot][3] < SMALL_DEPTH_WIDTH - SMALL_DEPTH;
        s->again[agains] = slot;
        agains += wanted & (s->is_again[slot] != 1);
        s->is_again[slot] = 1;
      }
    }
    KEEP_LOOP for (; left; left &= left - 1, kept++) {
      const int from = k + first_bit(left);
      s->near_cells[kept] = s->near_cells[from];
      memmove(s->corners[kept], s->corners[from], sizeof s->corners[0]);
    }
  }
  s->near = kept, s->agains = agains;
}

/* Choose of the near cells those whose interpolated depth can exceed -WIDTH; those in which it exceeds WIDTH everywhere
 * come first, `full` of them. */
FUNCTION void sort_cells(const Patch *p, Scratch *s) {
  int cells = 0, full = 0;
  KEEP_LOOP for (int k = 0; k < s->near; k += BLOCK) {
    const unsigned there = lowest_bits(s->near - k);
    Lanes v[12], overlaps[4], lowest, highest;
    int some[BLOCK];
    unsigned left, inside;
    for (int l = 0; l < BLOCK; l++) some[l] = there >> l & 1 ? k + l : k;
    corner_values(s, some, v, overlaps);
    hull_of(v, &lowest, &highest);
    inside = LOGARITHMIC ? 0 : bits_of(lowest > WIDTH);
    left = there & bits_of(highest > -WIDTH);
    KEEP_LOOP for (; left; left &= left - 1) {
      const int l = first_bit(left), is_full = inside >> l & (p->cells[s->near_cells[k + l]].present == 0);
      s->chosen[cells++] = s->chosen[full];
      s->chosen[is_full ? full : cells - 1] = k + l;
      full += is_full;
    }
  }
  s->cells = cells, s->full = full;
}

/* Cells that may matter, after a look at all their corners */
INLINE void search(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  int agains = 0;
  find_cells(p, pose, frame, s);
  memset(s->is_again, 0, s->nodes * sizeof s->is_again[0]);
  for (int k = 0; k < s->nodes; k += BLOCK) {
    const unsigned there = lowest_bits(s->nodes - k);
    unsigned deep;
    int slots[BLOCK];
    for (int l = 0; l < BLOCK; l++) slots[l] = k + l;
    deep = there & bits_of(fill_slots(p, slots, 0, pose, frame, 1, s) > SMALL_DEPTH - SMALL_DEPTH_WIDTH);
    for (int l = 0; l < BLOCK; l++) s->again[agains] = k + l, agains += deep >> l & 1;
  }
  s->agains = agains;
  keep_cells(s);
}

/* Another look at those corners of near cells that are worth it, or at all of them with their derivatives */
INLINE void fill_nodes(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  int agains = order < 2 ? s->agains : 0;
  for (int k = 0; k < s->near && order >= 2; k++) {
    for (int c = 0; c < 4; c++) {
      const int slot = s->corners[k][c];
      s->again[agains] = slot;
      agains += s->is_again[slot] != order;
      s->is_again[slot] = order;
    }
  }
  s->agains = agains;
  fill_up(s->again, s->agains);
  for (int k = 0; k < s->agains; k += BLOCK) {
    const Lanes overlap = node_overlaps(s, s->again + k);
    fill_slots(p, s->again + k, &overlap, pose, frame, order, s);
  }
  sort_cells(p, s);
}
