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
  const double (*present)[SUB_POINTS]; /* 1 at sub-points on the surface: of whole cells, then of those at the rim */
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
  double pose[6]; /* in which cells were chosen, where `searched`; `filled`: the order of what slots and sums hold */
  int searched, filled;
  int nodes, ids[MOST_NODES + BLOCK]; /* looked at */
  int near, near_cells[MOST_CELLS + BLOCK]; /* cells that may touch, */
  int cells, full, chosen[MOST_CELLS + BLOCK]; /* and of these those that matter */
  int groups[MOST_GROUPS];
  int slot[MOST_NODES]; /* of a node in what follows; holds where seen[node] is the present turn */
  unsigned seen[MOST_NODES], turn;
  int again[MOST_NODES + BLOCK], agains; /* slots that are worth a second look, */
  int is_again[MOST_NODES + BLOCK];      /* and of which order they had one */
  Sums sums;
  double value[MOST_NODES + BLOCK][4] __attribute__((aligned(64))); /* three, and the depth found at the node */
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
  if (++s->turn == 0) memset(s->seen, 0, sizeof s->seen), s->turn = 1;
}

/* Filled up with the last one, to whole lanes */
INLINE void fill_up(int *ids, int count) {
  for (int k = count; k % BLOCK; k++) ids[k] = ids[count - 1];
}

INLINE void want_corners(Scratch *s, const Cell *cell) {
  for (int k = 0; k < 4; k++) {
    const int node = cell->corners[k];
    if (s->seen[node] == s->turn) continue;
    s->seen[node] = s->turn, s->is_again[s->nodes] = 0, s->slot[node] = s->nodes, s->ids[s->nodes++] = node;
  }
}

/* Fill `near_cells` with the cells that may touch, and `ids` with their corners. */
FUNCTION void find_cells(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  int groups = 0;
  begin_turn(s);
  KEEP_LOOP for (int b = 0; b < p->block_count; b += BLOCK) {
    const Mask near = may_touch(p->block_boxes + b / BOXES, b % BOXES, pose, frame);
    KEEP_LOOP for (int l = 0; l < BLOCK; l++) {
      for (int k = p->blocks[b + l].first; near[l] && k < p->blocks[b + l].last; k++) s->groups[groups++] = k;
    }
  }
  KEEP_LOOP for (int g = 0; g < groups; g++) {
    KEEP_LOOP for (int first = 0; first < BOXES; first += BLOCK) {
      const Mask touch = may_touch(p->cell_boxes + s->groups[g], first, pose, frame);
      KEEP_LOOP for (int l = 0; l < BLOCK; l++) {
        const int cell = BOXES * s->groups[g] + first + l;
        if (!touch[l]) continue;
        want_corners(s, p->cells + cell);
        s->near_cells[s->near++] = cell;
      }
    }
  }
  fill_up(s->ids, s->nodes);
}

/* Values in BLOCK slots, where the depth found at the nodes themselves is `first`; with order 2 slopes by twist. */
INLINE void fill_slots(const Patch *p, const int *slots, Lanes first, const double *pose, const Frame *frame, int order,
                       Scratch *s) {
  int ids[BLOCK];
  Four row[BLOCK];
  Lanes column[4], slopes[3][6];
  Depth at;
  for (int l = 0; l < BLOCK; l++) ids[l] = s->ids[slots[l]];
  depth_at(p->nodes, ids, first, pose, frame, order, &at);
  for (int i = 0; i < 3; i++) column[i] = at.value[i];
  column[3] = any(first != 0.0) ? first : pick(at.sigma > FLATTEST + FLATTEST_WIDTH, at.d, all(0.0));
  to_rows(column, row);
  for (int l = 0; l < BLOCK; l++) memcpy(s->value[slots[l]], row + l, sizeof(Four));
  if (order < 2) return;
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

INLINE void corner_values(const Patch *p, const Scratch *s, const int *chosen, Lanes v[12]) {
  for (int c = 0; c < 4; c++) {
    Four row[BLOCK];
    Lanes column[4];
    for (int l = 0; l < BLOCK; l++) row[l] = four_at(s->value[s->slot[p->cells[chosen[l]].corners[c]]]);
    to_columns(row, column);
    for (int i = 0; i < 3; i++) v[3 * c + i] = column[i];
  }
}

/* Choose among cells those whose interpolated depth can exceed -WIDTH - spare; those in which it exceeds WIDTH
 * everywhere come first, `full` of them. A cubic lies within the hull of its Bezier points: the corners' values and a
 * third of their slopes further in. */
FUNCTION void sort_cells(const Patch *p, const int *cells, int count, double spare, Scratch *s) {
  s->cells = s->full = 0;
  for (int k = 0; k < count; k += BLOCK) {
    Lanes v[12], highest, lowest;
    int some[BLOCK];
    for (int l = 0; l < BLOCK; l++) some[l] = cells[k + l < count ? k + l : k];
    corner_values(p, s, some, v);
    for (int c = 0; c < 4; c++) {
      const Lanes along_u = (c < 2 ? 1.0 : -1.0) / 3.0 * v[3 * c + 1];
      const Lanes along_v = (c % 2 ? -1.0 : 1.0) / 3.0 * v[3 * c + 2];
      const Lanes high = v[3 * c] + larger_of(along_u, all(0.0)) + larger_of(along_v, all(0.0));
      const Lanes low = v[3 * c] + smaller_of(along_u, all(0.0)) + smaller_of(along_v, all(0.0));
      highest = c ? larger_of(highest, high) : high, lowest = c ? smaller_of(lowest, low) : low;
    }
    for (int l = 0; l < BLOCK && k + l < count; l++) {
      if (highest[l] <= -WIDTH - spare) continue;
      s->chosen[s->cells] = some[l];
      if (!LOGARITHMIC && lowest[l] > WIDTH && p->cells[some[l]].present == 0) {
        s->chosen[s->cells] = s->chosen[s->full], s->chosen[s->full++] = some[l];
      }
      s->cells++;
    }
  }
}

/* Cells that may matter, after a look at all their corners */
INLINE void search(const Patch *p, const double *pose, const Frame *frame, Scratch *s) {
  s->near = s->nodes = 0;
  find_cells(p, pose, frame, s);
  for (int first = 0; first < s->nodes; first += BLOCK) {
    int slots[BLOCK];
    for (int l = 0; l < BLOCK; l++) slots[l] = first + l;
    fill_slots(p, slots, all(0.0), pose, frame, 1, s);
  }
  sort_cells(p, s->near_cells, s->near, SPARE, s);
  s->near = s->cells;
  memcpy(s->near_cells, s->chosen, s->cells * sizeof s->chosen[0]);
}

/* Another look, with derivatives if asked for, at those corners of cells that matter. */
INLINE void fill_nodes(const Patch *p, const double *pose, const Frame *frame, int order, Scratch *s) {
  s->agains = 0;
  for (int k = 0; k < s->near; k++) {
    for (int c = 0; c < 4; c++) {
      const int slot = s->slot[p->cells[s->near_cells[k]].corners[c]];
      if (s->is_again[slot] == order) continue;
      if (order < 2 && fabs(s->value[slot][3]) <= SMALL_DEPTH - SMALL_DEPTH_WIDTH) continue;
      s->is_again[slot] = order, s->again[s->agains++] = slot;
    }
  }
  fill_up(s->again, s->agains);
  for (int k = 0; k < s->agains; k += BLOCK) {
    Lanes first;
    for (int l = 0; l < BLOCK; l++) first[l] = s->value[s->again[k + l]][3];
    fill_slots(p, s->again + k, first, pose, frame, order, s);
  }
  sort_cells(p, s->near_cells, s->near, 0.0, s);
}
